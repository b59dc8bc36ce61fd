//! glTF 2.0 and GLB files: the node tree with its transforms, triangles of every kind, base colours and their textures.
//!
//! The `gltf` crate reads container and schema. What its document stands on — bounds of accessors, a node tree without
//! cycles — is checked here, because its own iterators trust the file.

mod accessor;
mod colour;

use super::scan::{FacePaint, MAX_TRIANGLES, Scan};
use super::{Beside, Format, ImportError};
use accessor::Buffers;
use colour::Palette;
use glam::{Affine3A, Mat4, Quat, Vec3};
use gltf::Glb;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Asset, Node, Root};
use serde::Deserialize;
use std::borrow::Cow;

/// Triangles that any file may expand to; instances make more of them than the file has bytes.
const FREE_TRIANGLES: u64 = 1_000_000;

/// Extensions without which the geometry is still right; see [`colour`] for what becomes of the colours.
const HARMLESS: [&str; 3] = ["KHR_texture_", "KHR_materials_", "EXT_texture_"];

fn refuse(place: impl Into<String>, reason: impl ToString) -> ImportError {
    ImportError::syntax(Format::Gltf, place, reason)
}

/// All that every version has.
#[derive(Deserialize)]
struct Versioned {
    asset: Asset,
}

pub(super) fn read(bytes: &[u8], beside: &Beside<'_>) -> Result<Scan, ImportError> {
    let (json, binary) = chunks(bytes)?;
    // Version 1 has another schema, so this comes first.
    let Versioned { asset } = serde_json::from_slice(&json).map_err(|e| refuse("JSON", e))?;
    if !asset.version.starts_with("2.") {
        return Err(refuse("asset.version", format!("{:?} is not 2.0: export it as glTF 2.0", asset.version)));
    }
    let root: Root = serde_json::from_slice(&json).map_err(|e| refuse("JSON", e))?;
    let is_harmless =
        |name: &str| HARMLESS.iter().any(|prefix| name.starts_with(prefix)) || name == "KHR_mesh_quantization";
    if let Some(name) = root.extensions_required.iter().find(|name| !is_harmless(name)) {
        return Err(ImportError::Unsupported {
            what: format!("the glTF extension {name} is required"),
            advice: "export the file without compression or extensions, for example with Blender or gltf-transform",
        });
    }
    let buffers = Buffers::fetch(&root, binary.as_deref(), beside)?;
    let mut reader = Reader {
        palette: Palette::new(&root, &buffers, beside),
        root: &root,
        buffers: &buffers,
        scan: Scan::default(),
        limit: (FREE_TRIANGLES + bytes.len() as u64).min(MAX_TRIANGLES),
        skipped: 0,
    };
    for (node, transform) in placed_nodes(&root)? {
        reader.add_mesh(node, transform)?;
    }
    let Reader { mut scan, palette, skipped, .. } = reader;
    if skipped > 0 {
        scan.notes.push(format!("{skipped} primitives of points or lines were left out"));
    }
    palette.finish(&mut scan);
    Ok(scan)
}

/// The JSON and the binary chunk of a GLB file, or the whole of a glTF file.
#[expect(clippy::type_complexity)]
fn chunks(bytes: &[u8]) -> Result<(Cow<'_, [u8]>, Option<Cow<'_, [u8]>>), ImportError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.into(), None));
    }
    let word = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    if word(4) != Some(2) {
        return Err(refuse("GLB header", "the version is not 2: export it as glTF 2.0"));
    }
    let (length, have) = (word(8).unwrap_or(0) as usize, bytes.len());
    if !(12..=have).contains(&length) {
        return Err(refuse("GLB header", format!("it announces {length} bytes, the file has {have}: it is cut short")));
    }
    let Glb { json, bin, .. } =
        Glb::from_slice(bytes).map_err(|e| refuse("GLB chunks", format!("{e}: the file is cut short or damaged")))?;
    Ok((json, bin))
}

/// Nodes with a mesh, and where they are.
fn placed_nodes(root: &Root) -> Result<Vec<(usize, Affine3A)>, ImportError> {
    let is_child = {
        let mut is_child = vec![false; root.nodes.len()];
        let children = root.nodes.iter().flat_map(|node| node.children.iter().flatten());
        children.for_each(|child| is_child.get_mut(child.value()).into_iter().for_each(|flag| *flag = true));
        is_child
    };
    let tops = match root.scenes.get(root.scene.map_or(0, |scene| scene.value())) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        None => (0..root.nodes.len()).filter(|&node| !is_child[node]).collect::<Vec<_>>(),
    };
    let mut stack: Vec<(usize, Affine3A)> = tops.into_iter().rev().map(|node| (node, Affine3A::IDENTITY)).collect();
    let mut visited = vec![false; root.nodes.len()];
    let mut placed = Vec::new();
    while let Some((number, above)) = stack.pop() {
        let Some(node) = root.nodes.get(number) else {
            return Err(refuse(format!("node {number}"), format!("there are only {}", root.nodes.len())));
        };
        if std::mem::replace(&mut visited[number], true) {
            return Err(refuse(format!("node {number}"), "it is reached twice: nodes must form a tree"));
        }
        let transform = above * local_transform(node);
        if node.mesh.is_some() {
            placed.push((number, transform));
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform)));
    }
    Ok(placed)
}

fn local_transform(node: &Node) -> Affine3A {
    match &node.matrix {
        Some(matrix) => Affine3A::from_mat4(Mat4::from_cols_array(matrix)),
        None => Affine3A::from_scale_rotation_translation(
            node.scale.map_or(Vec3::ONE, Vec3::from),
            node.rotation.map_or(Quat::IDENTITY, |r| Quat::from_array(r.0).normalize()),
            node.translation.map_or(Vec3::ZERO, Vec3::from),
        ),
    }
}

struct Reader<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    palette: Palette<'a>,
    scan: Scan,
    limit: u64,
    skipped: usize,
}

impl Reader<'_> {
    fn add_mesh(&mut self, node: usize, transform: Affine3A) -> Result<(), ImportError> {
        let number = self.root.nodes[node].mesh.map_or(usize::MAX, |mesh| mesh.value());
        let Some(mesh) = self.root.meshes.get(number) else {
            return Err(refuse(format!("node {node}"), format!("its mesh {number} does not exist")));
        };
        for (part, primitive) in mesh.primitives.iter().enumerate() {
            let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
            match (primitive.mode, positions) {
                (
                    Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)),
                    Some(positions),
                ) => self.add_primitive(primitive, mode, positions.value(), transform).map_err(|e| match e {
                    ImportError::Syntax { format, place, reason } => ImportError::Syntax {
                        format,
                        place: format!("mesh {number}, primitive {part}, {place}"),
                        reason,
                    },
                    other => other,
                })?,
                _ => self.skipped += 1,
            }
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        primitive: &Primitive,
        mode: Mode,
        positions: usize,
        transform: Affine3A,
    ) -> Result<(), ImportError> {
        let positions = self.buffers.floats::<3>(positions)?;
        let indices = match primitive.indices {
            Some(indices) => self.buffers.indices(indices.value())?,
            None => (0..positions.len() as u32).collect(),
        };
        let faces = (if mode == Mode::Triangles { indices.len() / 3 } else { indices.len() }) as u64;
        let have = (self.scan.triangles.len() as u64).max(self.scan.vertices.len() as u64 / 3);
        if have + faces.max(positions.len() as u64 / 3) > self.limit {
            let what = format!("a node tree that expands to {} triangles", have + faces);
            return Err(ImportError::TooLarge { what, limit: self.limit });
        }
        let paint = self.palette.paint(primitive, positions.len())?;
        let base = self.scan.vertices.len() as u32;
        self.scan.vertices.extend(positions.iter().map(|&p| transform.transform_point3(p.into())));
        let flips = transform.matrix3.determinant() < 0.0;
        for (face, corners) in triangles(mode, &indices).enumerate() {
            let [a, b, c] = corners;
            let corners = if flips { [a, c, b] } else { [a, b, c] };
            if let Some(&vertex) = corners.iter().find(|&&corner| corner as usize >= positions.len()) {
                return Err(ImportError::Index { face, vertex, count: positions.len() });
            }
            let based = corners.map(|corner| corner + base);
            let uv = paint.uv.as_ref().map(|uv| corners.map(|c| uv[c as usize]));
            match (paint.image, uv) {
                (Some(image), Some(uv)) => self.scan.add_face(face, &based, &FacePaint::Image(image, &uv))?,
                _ => {
                    let colours = corners.map(|c| paint.colours.get(c as usize).copied().unwrap_or(paint.flat));
                    self.scan.add_face(face, &based, &FacePaint::Colours(&colours))?;
                }
            }
        }
        Ok(())
    }
}

/// Triangles of a list, a strip or a fan, all wound alike.
fn triangles(mode: Mode, indices: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    let count = if mode == Mode::Triangles { indices.len() / 3 } else { indices.len().saturating_sub(2) };
    (0..count).map(move |n| match mode {
        Mode::Triangles => [indices[3 * n], indices[3 * n + 1], indices[3 * n + 2]],
        Mode::TriangleStrip if n % 2 == 0 => [indices[n], indices[n + 1], indices[n + 2]],
        Mode::TriangleStrip => [indices[n + 1], indices[n], indices[n + 2]],
        _ => [indices[0], indices[n + 1], indices[n + 2]],
    })
}
