use super::*;
use proptest::prelude::*;

/// A WAD of lumps.
fn wad(lumps: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let (mut body, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in lumps {
        directory.extend([12 + body.len() as u32, bytes.len() as u32].map(u32::to_le_bytes).concat());
        directory.extend(Name::of(name).bytes());
        body.extend(bytes);
    }
    let header = [lumps.len() as u32, 12 + body.len() as u32].map(u32::to_le_bytes).concat();
    [b"IWAD".as_slice(), &header, &body, &directory].concat()
}

fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A patch two columns wide and 300 tall: index 1 at row 0, 2 at row 200, 3 at row 290 of both columns.
fn tall() -> Vec<u8> {
    let column = [0, 1, 0, 1, 0, 200, 1, 0, 2, 0, 90, 1, 0, 3, 0, END];
    let offsets = [16_u32, 16].map(u32::to_le_bytes).concat();
    [shorts(&[2, 300, 0, 0]), offsets, column.to_vec()].concat()
}

const END: u8 = 255;

/// A palette of greys, a texture of two patches beside each other, one outside of the texture, and a flat.
fn lumps() -> Vec<(&'static str, Vec<u8>)> {
    let palette = (0..=255).flat_map(|grey| [grey, grey, 7]).collect();
    let names = [vec![1, 0, 0, 0], Name::of("TALL").bytes().to_vec()].concat();
    let placed = |x: i16, y: i16| shorts(&[x as u16, y as u16, 0, 1, 0]);
    let wall = [
        Name::of("WALL").bytes().to_vec(),
        shorts(&[0, 0, 4, 256, 0, 0, 3]),
        placed(0, 0),
        placed(2, -100),
        placed(-9, 999),
    ]
    .concat();
    let broken = [Name::of("BROKEN").bytes().to_vec(), shorts(&[0, 0, 4, 4, 0, 0, 1, 0, 0, 5, 0, 0])].concat();
    let list = [2, 12, 12 + wall.len() as u32].map(u32::to_le_bytes).concat();
    vec![
        ("PLAYPAL", palette),
        ("PNAMES", names),
        ("TEXTURE1", [list, wall, broken].concat()),
        ("TALL", tall()),
        ("F_START", Vec::new()),
        ("FLOOR", (0..4096).map(|n| (n % 64) as u8).collect()),
        ("SHORT", vec![0; 99]),
        ("F_END", Vec::new()),
    ]
}

fn read(files: &[Vec<u8>]) -> Result<Option<Textures>, TextureError> {
    let wads: Vec<_> = files.iter().map(|bytes| Arc::new(Wad::parse(bytes.clone()).unwrap())).collect();
    Textures::read(&wads)
}

#[test]
fn patches_make_textures() {
    let textures = read(&[wad(&lumps())]).unwrap().unwrap();
    let image = textures.wall(Name::of("wall")).unwrap();
    assert_eq!((image.width, image.height), (4, 256));
    let at = |column: usize, row: usize| image.pixels[row * 4 + column][0];
    assert_eq!((at(0, 0), at(1, 200), at(1, 199)), (1, 2, 0));
    assert_eq!((at(2, 100), at(3, 190), at(2, 0)), (2, 3, 0), "rows 200 and 200 + 90 of the tall patch, 100 higher");
    let flat = textures.flat(Name::of("FLOOR")).unwrap();
    assert_eq!((flat.pixels[0], flat.pixels[65]), ([0, 0, 7], [1, 1, 7]));
}

#[test]
fn what_is_broken_is_told_where_it_is_used() {
    let file = wad(&lumps());
    let textures = read(std::slice::from_ref(&file)).unwrap().unwrap();
    let list = file.windows(6).position(|bytes| bytes == b"BROKEN").unwrap();
    let text = textures.wall(Name::of("BROKEN")).unwrap_err().to_string();
    assert!(text.contains("lump TEXTURE1") && text.contains(&format!("byte {}", list + 22)), "{text}");
    assert!(text.contains("patch 5, but PNAMES has 1"), "{text}");
    assert!(textures.wall(Name::of("NONE")).unwrap_err().to_string().contains("no wall texture NONE"));
    assert!(textures.flat(Name::of("SHORT")).unwrap_err().to_string().contains("4096 bytes"));
    let mut cut = lumps();
    cut[2].1.truncate(8);
    assert!(read(&[wad(&cut)]).unwrap_err().to_string().contains("list of offsets"));
    assert!(read(&[wad(&lumps()[1..])]).unwrap().is_none(), "no palette");
}

#[test]
fn later_files_override() {
    let red = [("PLAYPAL", [200, 0, 0].repeat(256)), ("TALL", tall())];
    let textures = read(&[wad(&lumps()), wad(&red)]).unwrap().unwrap();
    assert_eq!(textures.wall(Name::of("WALL")).unwrap().pixels[0], [200, 0, 0]);
}

proptest! {
    #[test]
    fn damaged_textures_never_panic(hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20)) {
        let mut bytes = wad(&lumps());
        for (at, value) in hits {
            // The header and the palette are not of interest here.
            let from = 12 + 768;
            let at = from + at.index(bytes.len() - from);
            bytes[at] = value;
        }
        let Ok(wad) = Wad::parse(bytes) else { return Ok(()) };
        if let Ok(Some(textures)) = Textures::read(&[Arc::new(wad)]) {
            let names: Vec<Name> = textures.walls.keys().chain(textures.flats.keys()).copied().collect();
            for name in names {
                // Only that it returns matters here.
                drop((textures.wall(name), textures.flat(name)));
            }
        }
    }
}
