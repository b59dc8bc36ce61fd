//! Bytes ↔ tensors: safetensors both ways, PyTorch's pickles inwards, and files that are whole or absent.

use super::names::{COUNTER, FIRST};
use super::tensors::Tensors;
use burn::store::pytorch_reader::{DType as TorchDType, PytorchReader};
use burn::tensor::{DType, TensorData};
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a file under a temporary name in the same folder, flushes it to the disk and renames it, so that a crash
/// leaves the old file or the new one, never half of one.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (temporary, mut file) = create_temporary(path)?;
    let written = file.write_all(bytes).and_then(|()| file.sync_all()).and_then(|()| fs::rename(&temporary, path));
    if written.is_err() {
        // The first error is the one to report; a leftover of an unwritable folder cannot be removed either.
        let _ = fs::remove_file(&temporary);
    }
    written?;
    // The rename itself is on the disk only when its folder is; not every system can open a folder.
    match path.parent().map(|dir| if dir.as_os_str().is_empty() { Path::new(".") } else { dir }).map(File::open) {
        Some(Ok(dir)) => dir.sync_all().or(Ok(())),
        _ => Ok(()),
    }
}

/// A new file beside `path` and its name, which nobody else has: not another program either, of which one on another machine
/// or in another container may have the same number.
///
/// # Errors
/// When the folder cannot be written to.
pub fn create_temporary(path: &Path) -> io::Result<(PathBuf, File)> {
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))?;
    let mut number = 0_u64;
    loop {
        let name = format!(".{}.{}.{number}.tmp", name.to_string_lossy(), std::process::id());
        let temporary = path.with_file_name(name);
        match File::create_new(&temporary) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            file => return Ok((temporary, file?)),
        }
    }
}

/// The bytes of a safetensors file that PyTorch's `load_state_dict(strict=True)` takes.
pub(super) fn to_safetensors(tensors: &Tensors) -> Result<Vec<u8>, String> {
    let zero = 0i64.to_le_bytes();
    let mut views = Vec::with_capacity(tensors.len() * 2);
    for (name, data) in tensors {
        let shape = data.shape().as_slice().to_vec();
        let dtype = match data.dtype() {
            DType::F16 => Dtype::F16,
            DType::BF16 => Dtype::BF16,
            _ => Dtype::F32,
        };
        let view = TensorView::new(dtype, shape, data.as_bytes()).map_err(|error| error.to_string())?;
        views.push((name.clone(), view));
        if let Some(norm) = name.strip_suffix("running_mean") {
            let counter = TensorView::new(Dtype::I64, Vec::new(), &zero).map_err(|error| error.to_string())?;
            views.push((format!("{norm}{COUNTER}"), counter));
        }
    }
    let about = HashMap::from([("format".to_owned(), "pt".to_owned())]);
    serialize(views, Some(about)).map_err(|error| error.to_string())
}

/// The tensors of a safetensors file, as f32.
pub(super) fn from_safetensors(bytes: &[u8]) -> Result<Tensors, String> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
    let mut tensors = Tensors::new();
    for (name, view) in file.iter().filter(|(name, _)| !name.ends_with(COUNTER)) {
        let dtype = match view.dtype() {
            Dtype::F32 => DType::F32,
            Dtype::F64 => DType::F64,
            Dtype::F16 => DType::F16,
            Dtype::BF16 => DType::BF16,
            other => return Err(format!("{name} holds {other:?}, not floating-point numbers")),
        };
        let data = TensorData::from_bytes_vec(view.data().to_vec(), view.shape().to_vec(), dtype);
        tensors.insert(name.to_owned(), data.convert::<f32>());
    }
    Ok(tensors)
}

/// The tensors of a PyTorch file, as f32.
///
/// The state dict may lie anywhere in it, under any prefix (`model_state_dict.`, `module.`): it is where the first
/// convolution is. What lies outside, such as the optimiser's state, is left alone.
pub(super) fn from_pytorch(path: &Path) -> Result<Tensors, String> {
    let reader = PytorchReader::new(path).map_err(|error| error.to_string())?;
    let mut keys = reader.keys();
    keys.sort();
    let Some(prefix) = keys.iter().find_map(|key| key.strip_suffix(FIRST)) else { return Ok(Tensors::new()) };
    let mut tensors = Tensors::new();
    for (name, key) in keys.iter().filter_map(|key| Some((key.strip_prefix(prefix)?, key))) {
        let Some(tensor) = reader.get(key).filter(|_| !name.ends_with(COUNTER)) else { continue };
        let dtype = match tensor.dtype() {
            TorchDType::F32 => DType::F32,
            TorchDType::F64 => DType::F64,
            TorchDType::F16 => DType::F16,
            TorchDType::BF16 => DType::BF16,
            other => return Err(format!("{key} holds {other:?}, not floating-point numbers")),
        };
        let bytes = tensor.read().map_err(|error| error.to_string())?;
        let data = TensorData::from_bytes_vec(bytes, tensor.shape().to_vec(), dtype);
        tensors.insert(name.to_owned(), data.convert::<f32>());
    }
    Ok(tensors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temporary_files_of_others_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        // Of a program in another container that has the same number.
        let (theirs, mut file) = create_temporary(&path).unwrap();
        file.write_all(b"theirs").unwrap();
        write_atomic(&path, b"ours").unwrap();
        assert_eq!((fs::read(&path).unwrap(), fs::read(&theirs).unwrap()), (b"ours".to_vec(), b"theirs".to_vec()));
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "nothing else is left there");
    }
}
