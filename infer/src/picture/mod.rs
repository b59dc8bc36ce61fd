//! Pictures of what an agent saw, thought and did, drawn without a graphics library.
//!
//! Maps are oriented like every image of the project (see [`nbp_env::window`]): seen from above, `+z` up and `+x` left.

mod colour;
mod film;
mod frame;
mod gif;
mod panel;
mod thought;
mod topdown;

pub use self::gif::{Gif, GifError};
pub(crate) use colour::height as height_colour;
pub use film::Film;
pub use nbp_dataset::draw::{PictureError, Rgb};
pub use panel::beside;
pub use thought::{encoder_layers, obstacle_map, plan, value_map};
pub use topdown::topdown;
