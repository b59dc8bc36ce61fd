use super::super::conv;
use super::*;

#[test]
#[ignore]
fn timing() {
    let on = Machine::new();
    let all = [
        (8, 16, 16, 128),
        (8, 32, 16, 128),
        (8, 32, 32, 64),
        (8, 64, 64, 32),
        (8, 128, 128, 16),
        (8, 256, 256, 8),
        (1, 16, 16, 128),
        (1, 64, 64, 32),
        (1, 256, 256, 8),
        (1, 64, 64, 256),
        (1, 256, 256, 64),
        (1, 512, 512, 32),
        (1, 1024, 1024, 16),
    ];
    let doubled = std::env::var("UP").is_ok();
    let one = std::env::var("ONE").ok().map(|n| n.parse::<usize>().unwrap());
    for (batch, cin, cout, side) in one.map_or(all.to_vec(), |one| vec![all[one]]) {
        let size = Geometry { batch, cin, cout, height: side, width: side, kernel: 3 };
        let x: Vec<f32> = (0..batch * cin * side * side).map(|i| (i * 7919 % 101) as f32 / 101.0).collect();
        let w: Vec<f32> = (0..cout * cin * 9).map(|i| (i * 31 % 103) as f32 / 103.0).collect();
        let b = vec![0.5; cout];
        let at = |o: usize, i: usize| w.as_chunks::<9>().0[o * cin + i];
        let mut best = [f64::MAX; 2];
        for _ in 0..if one.is_some() { 300 } else { 7 } {
            let t = std::time::Instant::now();
            std::hint::black_box(if doubled {
                super::super::up::direct(on, size, &x, &w, &b)
            } else {
                conv::direct(on, size, &x, &w, &b)
            });
            best[0] = best[0].min(t.elapsed().as_secs_f64());
            let t = std::time::Instant::now();
            std::hint::black_box(if doubled {
                convolve_doubled(on, size, &x, at, &b)
            } else {
                convolve(on, size, &x, at, &b)
            });
            best[1] = best[1].min(t.elapsed().as_secs_f64());
        }
        let (mut dw, mut ux, mut uw) = (f64::MAX, f64::MAX, f64::MAX);
        let g = vec![0.5; batch * cout * side * side];
        let g4 = vec![0.5; 4 * batch * cout * side * side];
        for _ in 0..5 {
            let t = std::time::Instant::now();
            std::hint::black_box(conv::backward(on, size, &x, &w, &g, false));
            dw = dw.min(t.elapsed().as_secs_f64());
            let t = std::time::Instant::now();
            std::hint::black_box(super::super::up::backward(on, size, &x, &w, &g4, false));
            uw = uw.min(t.elapsed().as_secs_f64());
            let t = std::time::Instant::now();
            std::hint::black_box(super::super::up::backward(on, size, &x, &w, &g4, true));
            ux = ux.min(t.elapsed().as_secs_f64());
        }
        println!("      dw {:.3} ms, up dw {:.3} ms, up both {:.3} ms", dw * 1e3, uw * 1e3, ux * 1e3);
        let flop = 2.0 * 9.0 * (batch * cin * cout * side * side) as f64;
        println!(
            "{batch} {cin:4} {cout:4} {side:4}: direct {:.3} ms ({:.0} GF/s) winograd {:.3} ms ({:.0} GF/s) {:.2}x",
            best[0] * 1e3,
            flop / best[0] / 1e9,
            best[1] * 1e3,
            flop / best[1] / 1e9,
            best[0] / best[1]
        );
    }
}

#[test]
fn equals_the_direct_convolution() {
    for (batch, cin, cout, height, width) in [
        (1, 1, 1, 2, 4),
        (2, 3, 5, 4, 6),
        (1, 8, 8, 16, 16),
        (3, 6, 9, 8, 8),
        (1, 16, 4, 20, 34),
        (5, 7, 11, 2, 4),
        (2, 5, 17, 10, 128),
        (2, 70, 3, 6, 4),
    ] {
        let size = Geometry { batch, cin, cout, height, width, kernel: 3 };
        let x: Vec<f32> = (0..batch * cin * height * width).map(|i| (i * 7919 % 101) as f32 / 101.0 - 0.4).collect();
        let w: Vec<f32> = (0..cout * cin * 9).map(|i| (i * 31 % 103) as f32 / 103.0 - 0.6).collect();
        let b: Vec<f32> = (0..cout).map(|i| i as f32).collect();
        for on in Machine::all() {
            let want = conv::direct(on, size, &x, &w, &b);
            let got = convolve(on, size, &x, |o, i| w.as_chunks::<9>().0[o * cin + i], &b);
            for (at, (got, want)) in got.iter().zip(&want).enumerate() {
                assert!((got - want).abs() < 1e-4, "{size:?}[{at}]: {got} {want}");
            }
        }
    }
}
