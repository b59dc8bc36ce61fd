//! The report of a bench in a real browser: what its scripts make of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tests::{refuse, succeed};

/// Chromium, named by `NBP_CHROMIUM` or on the path.
fn chromium() -> Option<PathBuf> {
    let named = std::env::var_os("NBP_CHROMIUM").map(PathBuf::from);
    let folders: Vec<PathBuf> =
        std::env::var_os("PATH").map(|path| std::env::split_paths(&path).collect()).unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    named.into_iter().chain(found).find(|path| path.is_file())
}

/// What it prints when it opens an address in a window of this size.
fn browse(chromium: &Path, address: &str, size: &str, action: &str) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args([&format!("--window-size={size}"), action, address])
        .stderr(Stdio::null())
        .output()
        .unwrap();
    assert!(output.status.success(), "{address}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A small bench, and its report.
fn bench(folder: &Path) -> PathBuf {
    let [scenes, out, config, page] = ["scenes", "bench", "bench.toml", "page.html"].map(|name| folder.join(name));
    let [scenes, out, config_name, page_name] = [&scenes, &out, &config, &page].map(|path| path.to_str().unwrap());
    succeed("dataset", &["generate", "--level", "simple", "--count", "2", "--seed", "3", "--out", scenes]);
    let rows = ["random", "fbe", "fbe-gain"].map(|name| format!("[[policies]]\nname = '{name}'\n")).concat();
    let set = format!("[[data]]\nname = 'tiny'\nsteps = 12\npaths = ['{scenes}']\n");
    fs::write(&config, format!("starts = 2\nreference = 'fbe'\nvisible = false\n{set}{rows}")).unwrap();
    succeed("infer", &["bench", "--config", config_name, "--out", out]);
    let told = succeed("infer", &["report", "--bench", out, "--out", page_name, "--figures"]);
    assert!(told.contains("page.html"), "{told}");
    assert_eq!(fs::read(&page).unwrap(), fs::read(Path::new(out).join("report.html")).unwrap());
    page
}

#[test]
fn a_report_shows_what_its_address_asks_for() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = folder.path().to_str().unwrap();
    refuse("infer", &["report", "--bench", nothing], &["holds no bench"]);
    let page = bench(folder.path());
    for name in ["coverage-tiny.svg", "scatter-tiny.svg", "episode-tiny.svg"] {
        assert!(fs::read_to_string(folder.path().join(name)).unwrap().ends_with("</svg>\n"), "{name}");
    }
    let Some(chromium) = chromium() else {
        println!("skipped: no Chromium (Debian: chromium) on the path or in NBP_CHROMIUM");
        return;
    };
    let address = format!("file://{}", page.display());
    let open = |state: &str| browse(&chromium, &format!("{address}{state}"), "1200,2600", "--dump-dom");
    let first = open("");
    let works = |dom: &str| {
        assert!(dom.contains("<p id=\"trouble\" role=\"alert\" hidden=\"\"></p>"), "a script failed: {dom}");
        assert!(dom.contains("<html lang=\"en\" class=\"js\">") && dom.matches("<table>").count() >= 1);
    };
    works(&first);
    assert_eq!(first.matches("class=\"mean d0\" d=\"M").count(), 3 + 3, "a line and a swatch for each policy");
    assert!(first.contains("step 12 · ") && first.contains("class=\"dot\""));
    let scene = first.split("<select name=\"scene\">").nth(1).unwrap().split("selected=\"\">").nth(1).unwrap();
    let scene = scene.split('<').next().unwrap();

    let asked = open(&format!("#set=tiny&row=random&scene={scene}&start=1&step=7&off=fbe&x=random&y=fbe-gain&by=auc"));
    works(&asked);
    assert!(
        asked.contains("step 7 · ") && asked.contains("selected=\"\">random<") && asked.contains("selected=\"\">1<")
    );
    assert_eq!(asked.matches("class=\"mean d0\" d=\"M").count(), 2 + 3, "one of them is switched off");
    assert!(asked.contains("fbe-gain is better than random in ") && asked.contains("random, AUC"));
    let way = |dom: &str| {
        dom.split("class=\"path way\"")
            .nth(1)
            .unwrap()
            .split("d=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .matches('L')
            .count()
    };
    assert_eq!((way(&first), way(&asked)), (12, 7), "the walked path has as many pieces as steps");
    // Nonsense in the address is no fault.
    works(&open("#set=none&row=%3Cb%3E&scene=&start=-1&step=NaN&x=9&by=size"));

    for (size, name) in [("1200,2600", "wide.png"), ("500,3000", "narrow.png")] {
        let file = folder.path().join(name);
        browse(&chromium, &address, size, &format!("--screenshot={}", file.display()));
        let mut reader =
            png::Decoder::new(std::io::BufReader::new(fs::File::open(&file).unwrap())).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let step = info.color_type.samples();
        let ground = &pixels[..step];
        let drawn = pixels.chunks_exact(step).filter(|pixel| *pixel != ground).count();
        let share = drawn as f64 / (info.width * info.height) as f64;
        assert!((0.02..0.7).contains(&share), "{name}: {share}");
    }
}
