//! What a map is made of: names of textures and flats, and how bright its rooms are.
//!
//! Every name is in Doom II and in Freedoom, so a generated WAD shows no missing texture with either.

use crate::doom_map::Name;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// A floor or a ceiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Surface {
    /// Map units.
    pub(crate) height: i32,
    /// Seen from above or below.
    pub(crate) flat: Name,
    /// Texture on its edge, towards a lower floor or a higher ceiling.
    pub(crate) edge: Name,
}

/// The air between a floor and a ceiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Air {
    /// Below.
    pub(crate) floor: Surface,
    /// Above.
    pub(crate) ceiling: Surface,
    /// Texture of the solid around it.
    pub(crate) wall: Name,
    /// 0 to 255.
    pub(crate) light: u16,
}

impl Air {
    /// The same materials between other heights.
    pub(crate) fn between(mut self, floor: i32, ceiling: i32) -> Self {
        (self.floor.height, self.ceiling.height) = (floor, ceiling);
        self
    }

    /// The same with another wall.
    pub(crate) fn with_wall(mut self, wall: Name) -> Self {
        self.wall = wall;
        self
    }
}

/// Materials that go together.
#[derive(Debug)]
pub(crate) struct Theme {
    walls: &'static [Name],
    floors: &'static [Name],
    ceilings: &'static [Name],
    panels: &'static [Name],
    pillars: &'static [Name],
    insets: &'static [Name],
    crates: &'static [(Name, Name)],
    lamps: &'static [Name],
    trim: Name,
    riser: Name,
    /// Wall, floor and ceiling of corridors.
    corridor: [Name; 3],
}

impl Theme {
    /// One of the themes.
    pub(crate) fn draw(rng: &mut Rng) -> &'static Self {
        pick(&[&TECH, &URBAN, &HELL], rng)
    }

    /// A room's materials between two heights.
    pub(crate) fn room(&self, floor: i32, ceiling: i32, rng: &mut Rng) -> Air {
        let wall = pick(self.walls, rng);
        Air {
            floor: Surface { height: floor, flat: pick(self.floors, rng), edge: self.riser },
            ceiling: Surface { height: ceiling, flat: pick(self.ceilings, rng), edge: wall },
            wall,
            light: rng.random_range(8..=13) * 16,
        }
    }

    /// A corridor's materials.
    pub(crate) fn corridor(&self, floor: i32, ceiling: i32) -> Air {
        let [wall, floor_flat, ceiling_flat] = self.corridor;
        Air {
            floor: Surface { height: floor, flat: floor_flat, edge: self.riser },
            ceiling: Surface { height: ceiling, flat: ceiling_flat, edge: wall },
            wall,
            light: 144,
        }
    }

    /// The frame of a door or window.
    pub(crate) fn frame(&self, floor: i32, ceiling: i32) -> Air {
        let mut air = self.corridor(floor, ceiling).with_wall(self.trim);
        air.ceiling.edge = self.trim;
        air
    }

    /// Something in the wall to look at.
    pub(crate) fn panel(&self, rng: &mut Rng) -> Name {
        pick(self.panels, rng)
    }

    /// A pillar's side.
    pub(crate) fn pillar(&self, rng: &mut Rng) -> Name {
        pick(self.pillars, rng)
    }

    /// The top of a crate of a height.
    pub(crate) fn crate_top(&self, height: i32, rng: &mut Rng) -> Surface {
        let (edge, flat) = pick(self.crates, rng);
        Surface { height, flat, edge }
    }

    /// A floor let into another.
    pub(crate) fn inset(&self, height: i32, rng: &mut Rng) -> Surface {
        Surface { height, flat: pick(self.insets, rng), edge: self.riser }
    }

    /// A lamp in the ceiling.
    pub(crate) fn lamp(&self, height: i32, rng: &mut Rng) -> Surface {
        Surface { height, flat: pick(self.lamps, rng), edge: self.trim }
    }

    /// Beams, rims, steps.
    pub(crate) fn trim(&self, height: i32, flat: Name) -> Surface {
        Surface { height, flat, edge: self.trim }
    }
}

fn pick<T: Copy>(choice: &'static [T], rng: &mut Rng) -> T {
    *choice.choose(rng).unwrap_or(&choice[0])
}

const fn names<const N: usize>(texts: [&str; N]) -> [Name; N] {
    let (mut names, mut at) = ([Name::NONE; N], 0);
    while at < N {
        names[at] = Name::of(texts[at]);
        at += 1;
    }
    names
}

const CRATES: &[(Name, Name)] = &[(Name::of("CRATE1"), Name::of("CRATOP2")), (Name::of("CRATE2"), Name::of("CRATOP1"))];

const TECH: Theme = Theme {
    walls: &names([
        "STARTAN2", "STARGR1", "STARG3", "STARBR2", "GRAY1", "GRAY7", "BROWN1", "BROWN96", "METAL2", "TEKGREN2",
    ]),
    floors: &names(["FLOOR4_8", "FLOOR0_1", "FLOOR3_3", "FLAT14", "FLOOR5_1", "FLAT3", "FLOOR0_2"]),
    ceilings: &names(["CEIL3_5", "CEIL5_1", "FLAT19", "FLAT4", "CEIL3_1", "CEIL5_2", "FLAT1"]),
    panels: &names(["COMPTALL", "COMPSTA1", "COMPSTA2", "COMPWERD", "LITE3", "SILVER3", "PIPE2"]),
    pillars: &names(["SHAWN2", "SUPPORT2", "COMPSPAN", "METAL2", "TEKLITE"]),
    insets: &names(["NUKAGE1", "FLAT23", "CEIL4_2", "FLAT20", "SLIME14", "FWATER1"]),
    crates: CRATES,
    lamps: &names(["TLITE6_1", "TLITE6_5", "TLITE6_6", "CEIL1_2", "FLAT2"]),
    trim: Name::of("SHAWN2"),
    riser: Name::of("STEP4"),
    corridor: names(["BROWNGRN", "FLAT5_4", "CEIL5_1"]),
};

const URBAN: Theme = Theme {
    walls: &names([
        "BRICK1", "BRICK10", "BIGBRIK1", "BIGBRIK2", "STUCCO", "STONE2", "STONE", "BSTONE2", "WOOD1", "MODWALL1",
    ]),
    floors: &names(["FLAT5_4", "FLAT5_1", "FLAT1_1", "FLAT1_2", "FLOOR7_1", "FLAT5_5", "RROCK14", "FLOOR4_6"]),
    ceilings: &names(["CEIL5_1", "CEIL5_2", "FLAT1", "FLAT19", "FLOOR5_4", "RROCK10", "CEIL1_1"]),
    panels: &names(["PANBOOK", "PANCASE1", "PANEL3", "WOOD4", "MODWALL3", "BRNSMAL1"]),
    pillars: &names(["WOOD12", "METAL", "SUPPORT3", "BRICK12", "CEMENT7"]),
    insets: &names(["FWATER1", "GRASS1", "FLOOR1_1", "FLAT5_2", "RROCK13", "SLIME15"]),
    crates: CRATES,
    lamps: &names(["TLITE6_1", "TLITE6_4", "CEIL1_3", "TLITE6_6"]),
    trim: Name::of("METAL"),
    riser: Name::of("STEP6"),
    corridor: names(["GRAY1", "FLAT5_4", "CEIL5_1"]),
};

const HELL: Theme = Theme {
    walls: &names([
        "MARBLE1", "MARBLE2", "MARBGRAY", "GSTONE1", "ASHWALL2", "ROCK2", "ROCKRED1", "BRICK10", "SP_HOT1", "STONE3",
    ]),
    floors: &names(["DEM1_6", "FLOOR7_2", "FLOOR7_1", "FLAT5_8", "FLOOR6_2", "GRNROCK", "SLIME13"]),
    ceilings: &names(["DEM1_5", "FLOOR7_2", "CEIL5_2", "MFLR8_2", "FLAT5_1", "RROCK09", "FLOOR6_1"]),
    panels: &names(["MARBFACE", "GSTLION", "GSTSATYR", "SKSNAKE1", "WOODMET1", "MARBFAC2"]),
    pillars: &names(["METAL", "SUPPORT3", "MARBLE3", "WOODMET1", "GSTONE1"]),
    insets: &names(["LAVA1", "BLOOD1", "RROCK03", "FLAT10", "SFLR6_1"]),
    crates: &[(Name::of("WOODMET1"), Name::of("CEIL5_2")), (Name::of("METAL"), Name::of("CEIL5_2"))],
    lamps: &names(["TLITE6_5", "CEIL1_2", "RROCK01", "LAVA1"]),
    trim: Name::of("METAL"),
    riser: Name::of("STEP6"),
    corridor: names(["WOOD1", "FLAT5_2", "CEIL5_2"]),
};
