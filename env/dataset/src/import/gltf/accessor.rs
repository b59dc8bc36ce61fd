//! Numbers out of glTF buffers, every bound checked.

use super::refuse;
use crate::import::{Beside, ImportError};
use base64::Engine as _;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Buffer, Root};
use std::borrow::Cow;

/// The document with its buffers.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> Buffers<'a> {
    /// Fetches all buffers: the binary chunk, data inside the document, files beside it.
    pub(super) fn fetch(root: &'a Root, binary: Option<&'a [u8]>, beside: &Beside<'_>) -> Result<Self, ImportError> {
        let fetch = |(number, buffer): (usize, &'a Buffer)| match (&buffer.uri, binary) {
            (Some(uri), _) => fetch(uri, beside).map(Cow::Owned),
            (None, Some(binary)) if number == 0 => Ok(Cow::Borrowed(binary)),
            (None, _) => Err(refuse(format!("buffer {number}"), "it has neither a uri nor a binary chunk")),
        };
        Ok(Self { root, buffers: root.buffers.iter().enumerate().map(fetch).collect::<Result<_, _>>()? })
    }

    /// The bytes of a view and its stride.
    pub(super) fn view(&self, number: usize) -> Result<(&[u8], Option<usize>), ImportError> {
        let place = || format!("buffer view {number}");
        let view = self.root.buffer_views.get(number).ok_or_else(|| refuse(place(), "there is none of this number"))?;
        let buffer =
            self.buffers.get(view.buffer.value()).ok_or_else(|| refuse(place(), "its buffer does not exist"))?;
        let begin = view.byte_offset.map_or(0, |offset| offset.0 as usize);
        let end = begin.saturating_add(view.byte_length.0 as usize);
        let bytes = buffer.get(begin..end).ok_or_else(|| {
            refuse(place(), format!("it ends at byte {end} of a buffer of {}: the file is cut short", buffer.len()))
        })?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }

    /// The items of an accessor of `N` components as floating-point numbers; integers that are normalized become shares.
    pub(super) fn floats<const N: usize>(&self, number: usize) -> Result<Vec<[f32; N]>, ImportError> {
        let (accessor, kind, items) = self.items(number, N)?;
        let width = kind.size();
        let scale = match (accessor.normalized, kind) {
            (true, ComponentType::I8) => 127.0,
            (true, ComponentType::U8) => 255.0,
            (true, ComponentType::I16) => 32767.0,
            (true, ComponentType::U16) => 65535.0,
            _ => 1.0,
        };
        let component = |bytes: &[u8]| match (kind, bytes) {
            (ComponentType::I8, &[a]) => f32::from(a as i8),
            (ComponentType::U8, &[a]) => f32::from(a),
            (ComponentType::I16, &[a, b]) => f32::from(i16::from_le_bytes([a, b])),
            (ComponentType::U16, &[a, b]) => f32::from(u16::from_le_bytes([a, b])),
            (ComponentType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]) as f32,
            (ComponentType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            _ => f32::NAN,
        };
        let item = |bytes: &[u8]| std::array::from_fn(|n| component(&bytes[n * width..][..width]) / scale);
        Ok(items.map(item).collect())
    }

    /// The items of an accessor of indices.
    pub(super) fn indices(&self, number: usize) -> Result<Vec<u32>, ImportError> {
        let (_, kind, items) = self.items(number, 1)?;
        if !matches!(kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(refuse(format!("accessor {number}"), "indices must be unsigned integers"));
        }
        Ok(items.map(|item| item.iter().rev().fold(0, |sum, &byte| sum << 8 | u32::from(byte))).collect())
    }

    /// Number of components of an accessor.
    pub(super) fn components(&self, number: usize) -> Option<usize> {
        components(self.root.accessors.get(number)?)
    }

    /// The accessor, the kind of its components, and the bytes of each item.
    fn items(
        &self,
        number: usize,
        components_wanted: usize,
    ) -> Result<(&Accessor, ComponentType, impl Iterator<Item = &[u8]>), ImportError> {
        let refuse = |reason: &str| refuse(format!("accessor {number}"), reason);
        let accessor = self.root.accessors.get(number).ok_or_else(|| refuse("there is none of this number"))?;
        if components(accessor) != Some(components_wanted) {
            return Err(refuse(&format!(
                "it is a {:?}, but {components_wanted} components are needed",
                accessor.type_
            )));
        }
        let Checked::Valid(kind) = accessor.component_type else {
            return Err(refuse("its component type does not exist"));
        };
        let (Some(view), None) = (accessor.buffer_view, &accessor.sparse) else {
            return Err(refuse("it is sparse or has no buffer view: export the mesh without sparse accessors"));
        };
        let (bytes, stride) = self.view(view.value())?;
        let size = kind.0.size() * components_wanted;
        let stride = stride.unwrap_or(size).max(size);
        let bytes = bytes.get(accessor.byte_offset.map_or(0, |offset| offset.0 as usize)..).unwrap_or_default();
        // The last item needs no full stride.
        let available = if bytes.len() < size { 0 } else { (bytes.len() - size) / stride + 1 };
        let count = accessor.count.0 as usize;
        if count > available {
            return Err(refuse(&format!("it has {count} items, its buffer view holds {available}")));
        }
        let items = (0..count).map(move |n| &bytes[n * stride..][..size]);
        Ok((accessor, kind.0, items))
    }
}

/// Components of a vector; matrices are not used for what is read.
fn components(accessor: &Accessor) -> Option<usize> {
    match accessor.type_ {
        Checked::Valid(kind @ (Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4)) => Some(kind.multiplicity()),
        _ => None,
    }
}

/// The bytes behind a uri: data inside it, or a file beside the document.
pub(super) fn fetch(uri: &str, beside: &Beside<'_>) -> Result<Vec<u8>, ImportError> {
    let missing = |reason: String| ImportError::Missing { name: uri.chars().take(80).collect(), reason };
    match uri.strip_prefix("data:") {
        Some(data) => {
            let (_, text) = data.split_once(";base64,").ok_or_else(|| missing("it is not in base 64".into()))?;
            base64::engine::general_purpose::STANDARD.decode(text).map_err(|e| missing(e.to_string()))
        }
        None => beside(&unescape(uri)).map_err(missing),
    }
}

/// `%20` and the like as the bytes that they stand for.
fn unescape(uri: &str) -> String {
    let mut plain = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let escaped = tail.get(..2).filter(|_| *first == b'%').and_then(|hex| std::str::from_utf8(hex).ok());
        match escaped.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                plain.push(byte);
                rest = &tail[2..];
            }
            None => {
                plain.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&plain).into_owned()
}
