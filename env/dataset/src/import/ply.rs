//! PLY files, text or binary: polygons, colours at vertices or faces, textures as MeshLab writes them.

use super::scan::{FacePaint, MAX_TRIANGLES, Scan};
use super::{Beside, Format, ImportError};
use glam::{Vec2, Vec3};
use nbp_env::scene::Image;
use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{ElementDef, PlyFormat, PlyHeader, PlyReader, PropertyType, ScalarType};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

fn refuse(place: impl Into<String>, reason: impl ToString) -> ImportError {
    // Every level of the library repeats these words.
    let reason = reason.to_string().replace("Error while deserializing ply: ", "");
    let reason = reason.replace("failed to fill whole buffer", "the file ends here: it is cut short");
    ImportError::syntax(Format::Ply, place, reason)
}

pub(super) fn read(bytes: &[u8], beside: &Beside<'_>) -> Result<Scan, ImportError> {
    let header = PlyReader::from_reader(bytes).map_err(|e| refuse("header", e))?.header().clone();
    check_sizes(&header, bytes.len())?;
    // The last number of a text needs a blank after it.
    let needs_end = header.format == PlyFormat::Ascii && bytes.last() != Some(&b'\n');
    let bytes = if needs_end { Cow::Owned([bytes, b"\n"].concat()) } else { Cow::Borrowed(bytes) };
    let mut reader = PlyReader::from_reader(&*bytes).map_err(|e| refuse("header", e))?;
    let (mut vertices, mut faces) = (Rows(Vec::new()), Faces::default());
    for element in &header.elem_defs {
        let place = |e| refuse(format!("element {}", element.name), e);
        match element.name.as_str() {
            "vertex" => vertices = reader.next_element::<Rows<Vertex>>().map_err(place)?,
            "face" => faces = reader.next_element::<Faces>().map_err(place)?,
            _ => drop(reader.next_element::<Rows<Nothing>>().map_err(place)?),
        }
    }
    let has = |element: &str, name: &str| {
        let of = |e: &&ElementDef| {
            e.name == element && NAMES.iter().any(|n| n.contains(&name) && n.iter().any(|n| e.has_property(n)))
        };
        header.elem_defs.iter().find(of).is_some()
    };
    let mut scan = Scan { vertices: vertices.0.iter().map(|v| Vec3::new(v.x, v.y, v.z)).collect(), ..Scan::default() };
    let textures = textures(&header, beside, &mut scan);
    let at_vertices = has("vertex", "s");
    let colours = [has("face", "red"), has("vertex", "red")];
    let (mut from, mut from_uv) = (0, 0);
    let (mut uv, mut shades) = (Vec::new(), Vec::new());
    for (face, (&to, &to_uv)) in faces.ends.iter().zip(&faces.uv_ends).enumerate() {
        let (corners, numbers) = (&faces.corners[from..to], &faces.uv[from_uv..to_uv]);
        (from, from_uv) = (to, to_uv);
        let vertex = |&corner: &u32| vertices.0.get(corner as usize);
        uv.clear();
        if numbers.len() == 2 * corners.len() {
            uv.extend(numbers.chunks_exact(2).map(|n| Vec2::new(n[0], n[1])));
        } else if at_vertices {
            uv.extend(corners.iter().filter_map(vertex).map(|v| Vec2::new(v.s, v.t)));
        }
        shades.clear();
        shades.extend(match colours {
            [true, _] => vec![faces.colours[face]; corners.len()],
            [_, true] => corners.iter().filter_map(vertex).map(|v| [v.red.0, v.green.0, v.blue.0]).collect(),
            _ if textures.is_empty() => Vec::new(),
            _ => vec![[255; 3]; corners.len()],
        });
        let image = textures.get(faces.textures[face] as usize).copied().flatten();
        let paint = match image {
            Some(image) if uv.len() == corners.len() && uv.iter().all(|c| c.is_finite()) => {
                FacePaint::Image(image, &uv)
            }
            _ if shades.len() == corners.len() => FacePaint::Colours(&shades),
            _ if shades.is_empty() => FacePaint::Bare,
            // Only where a corner is out of range; adding the face says so.
            _ => FacePaint::Bare,
        };
        scan.add_face(face, corners, &paint)?;
    }
    Ok(scan)
}

/// Names of a property, the usual one first.
const NAMES: [&[&str]; 2] = [&["red", "diffuse_red", "r"], &["s", "u", "texture_u"]];

/// Refuses headers that promise more rows than the file can hold.
fn check_sizes(header: &PlyHeader, bytes: usize) -> Result<(), ImportError> {
    let mut total = 0_u128;
    for element in &header.elem_defs {
        if element.count > 0 && element.properties.is_empty() {
            return Err(refuse(format!("element {}", element.name), "it has rows, but no property"));
        }
        let least: usize = element.properties.iter().map(|p| least_bytes(header.format, &p.property_type)).sum();
        total += least as u128 * element.count as u128;
        // The blank after the last number of a text may be missing.
        if total > bytes as u128 + 1 {
            let reason =
                format!("the header promises {} rows, which the file of {bytes} bytes cannot hold", element.count);
            return Err(refuse(format!("element {}", element.name), reason));
        }
        if element.count as u64 > MAX_TRIANGLES {
            let what = format!("an element {} of {} rows", element.name, element.count);
            return Err(ImportError::TooLarge { what, limit: MAX_TRIANGLES });
        }
    }
    Ok(())
}

fn least_bytes(format: PlyFormat, property: &PropertyType) -> usize {
    let first = match *property {
        PropertyType::Scalar(scalar) => scalar,
        PropertyType::List { count_type, .. } => count_type,
    };
    match (format, first) {
        // A digit and a blank.
        (PlyFormat::Ascii, _) => 2,
        (_, ScalarType::I8 | ScalarType::U8) => 1,
        (_, ScalarType::I16 | ScalarType::U16) => 2,
        (_, ScalarType::I32 | ScalarType::U32 | ScalarType::F32) => 4,
        (_, ScalarType::F64) => 8,
    }
}

/// The images named in comments; `None` for one that cannot be had.
fn textures(header: &PlyHeader, beside: &Beside<'_>, scan: &mut Scan) -> Vec<Option<u32>> {
    let names = header.comments.iter().filter_map(|comment| comment.strip_prefix("TextureFile "));
    let (mut known, mut pixels) = (BTreeMap::new(), 0);
    let mut read = |name: &str| {
        let image = beside(name)
            .and_then(|bytes| Image::decode_counted(&bytes, &mut pixels).map_err(|error| error.to_string()))
            .map_err(|reason| {
                scan.notes.push(format!("texture {name}: {reason}; its faces have the colours of their corners"));
            })
            .ok()?;
        scan.images.push(image);
        Some(scan.images.len() as u32 - 1)
    };
    names.map(|name| *known.entry(name.trim()).or_insert_with(|| read(name.trim()))).collect()
}

#[derive(Deserialize)]
struct Nothing {}

#[derive(Deserialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    #[serde(default, alias = "diffuse_red", alias = "r")]
    red: Channel,
    #[serde(default, alias = "diffuse_green", alias = "g")]
    green: Channel,
    #[serde(default, alias = "diffuse_blue", alias = "b")]
    blue: Channel,
    #[serde(default, alias = "u", alias = "texture_u")]
    s: f32,
    #[serde(default, alias = "v", alias = "texture_v")]
    t: f32,
}

/// A byte, or a share of one where the file has floating-point colours.
#[derive(Clone, Copy, Default)]
struct Channel(u8);

impl<'de> Deserialize<'de> for Channel {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl Visitor<'_> for Any {
            type Value = Channel;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour")
            }
            fn visit_u64<E: Error>(self, value: u64) -> Result<Channel, E> {
                Ok(Channel(value.min(255) as u8))
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Channel, E> {
                Ok(Channel(value.clamp(0, 255) as u8))
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Channel, E> {
                Ok(Channel((value * 255.0).round() as u8))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

/// Rows that say which of them is wrong.
struct Rows<T>(Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Rows<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct All<T>(Vec<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for All<T> {
            type Value = Rows<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("rows")
            }
            fn visit_seq<A: SeqAccess<'de>>(mut self, mut rows: A) -> Result<Rows<T>, A::Error> {
                while let Some(row) = rows.next_element().map_err(|e| in_row(self.0.len(), &e))? {
                    // A row of nothing needs no memory.
                    self.0.push(row);
                }
                Ok(Rows(self.0))
            }
        }
        deserializer.deserialize_seq(All(Vec::new()))
    }
}

fn in_row<E: Error>(row: usize, error: &E) -> E {
    E::custom(format!("row {row}: {error}"))
}

/// Polygons of any size, one after the other.
#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    /// Where each face's corners end.
    ends: Vec<usize>,
    uv: Vec<f32>,
    uv_ends: Vec<usize>,
    textures: Vec<u32>,
    colours: Vec<[u8; 3]>,
}

#[derive(Deserialize)]
#[serde(field_identifier, rename_all = "snake_case")]
enum Property {
    #[serde(alias = "vertex_index")]
    VertexIndices,
    Texcoord,
    Texnumber,
    #[serde(alias = "diffuse_red")]
    Red,
    #[serde(alias = "diffuse_green")]
    Green,
    #[serde(alias = "diffuse_blue")]
    Blue,
    #[serde(other)]
    Other,
}

impl<'de> Deserialize<'de> for Faces {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct All;
        impl<'de> Visitor<'de> for All {
            type Value = Faces;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("faces")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<Faces, A::Error> {
                let mut faces = Faces::default();
                while rows.next_element_seed(OneFace(&mut faces)).map_err(|e| in_row(faces.ends.len(), &e))?.is_some() {
                    faces.ends.push(faces.corners.len());
                    faces.uv_ends.push(faces.uv.len());
                }
                Ok(faces)
            }
        }
        deserializer.deserialize_seq(All)
    }
}

struct OneFace<'a>(&'a mut Faces);

impl<'de> DeserializeSeed<'de> for OneFace<'_> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for OneFace<'_> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a face")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut row: A) -> Result<(), A::Error> {
        let (mut texture, mut colour) = (0, [0; 3]);
        while let Some(property) = row.next_key::<Property>()? {
            match property {
                Property::VertexIndices => row.next_value_seed(Append(&mut self.0.corners))?,
                Property::Texcoord => row.next_value_seed(Append(&mut self.0.uv))?,
                Property::Texnumber => texture = row.next_value()?,
                Property::Red => colour[0] = row.next_value::<Channel>()?.0,
                Property::Green => colour[1] = row.next_value::<Channel>()?.0,
                Property::Blue => colour[2] = row.next_value::<Channel>()?.0,
                Property::Other => drop(row.next_value::<IgnoredAny>()?),
            }
        }
        self.0.textures.push(texture);
        self.0.colours.push(colour);
        Ok(())
    }
}

/// A list, appended to what is there.
struct Append<'a, T>(&'a mut Vec<T>);

impl<'de, T: Deserialize<'de>> DeserializeSeed<'de> for Append<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for Append<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        while let Some(item) = list.next_element()? {
            self.0.push(item);
        }
        Ok(())
    }
}
