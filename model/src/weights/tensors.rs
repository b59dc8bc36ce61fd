//! All tensors of a network by their names in files, out of it and into it.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};
use std::collections::BTreeMap;

/// Name → numbers (f32 but for what is about to be stored).
pub(super) type Tensors = BTreeMap<String, TensorData>;

/// How a file's tensors differ from those a network has.
#[derive(Debug, Default)]
pub(super) struct Difference {
    pub(super) missing: Vec<String>,
    pub(super) unknown: Vec<String>,
    pub(super) reshaped: Vec<String>,
}

impl Difference {
    pub(super) fn is_empty(&self) -> bool {
        self.missing.is_empty() && self.unknown.is_empty() && self.reshaped.is_empty()
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        const SHOWN: usize = 3;
        let parts = [("missing", &self.missing), ("unknown", &self.unknown), ("of another shape", &self.reshaped)];
        let said = parts.iter().filter(|(_, names)| !names.is_empty()).map(|(what, names)| {
            let more = if names.len() > SHOWN { ", …" } else { "" };
            format!("{} {what}: {}{more}", names.len(), names[..names.len().min(SHOWN)].join(", "))
        });
        f.write_str(&said.collect::<Vec<_>>().join("; "))
    }
}

/// From the path of a tensor in its module to its name in files.
pub(super) type Naming = fn(&str) -> String;

/// Reads all tensors of a network that is not on a tape (`net.valid()`).
pub(super) fn collect(net: &impl Module, naming: Naming) -> Tensors {
    let mut reader = Reader { path: Path::new(naming), tensors: Tensors::new() };
    net.visit(&mut reader);
    reader.tensors
}

/// What `tensors` lacks, has too much or has in another shape.
pub(super) fn compare(net: &impl Module, naming: Naming, tensors: &Tensors) -> Difference {
    let mut shapes = Shapes { path: Path::new(naming), shapes: BTreeMap::new() };
    net.visit(&mut shapes);
    let mut difference = Difference::default();
    for (name, wanted) in &shapes.shapes {
        match tensors.get(name) {
            None => difference.missing.push(name.clone()),
            Some(data) if data.shape().as_slice() != wanted.as_slice() => {
                difference.reshaped.push(format!("{name} {:?} instead of {wanted:?}", data.shape().as_slice()));
            }
            Some(_) => {}
        }
    }
    difference.unknown = tensors.keys().filter(|name| !shapes.shapes.contains_key(*name)).cloned().collect();
    difference
}

/// Puts tensors, which must have been compared, into a network; it stays on its device and its tape.
pub(super) fn apply<M: Module>(net: M, naming: Naming, tensors: Tensors) -> M {
    net.map(&mut Writer { path: Path::new(naming), tensors })
}

/// The path of the module that is being walked.
struct Path {
    parts: Vec<String>,
    naming: Naming,
}

impl Path {
    fn new(naming: Naming) -> Self {
        Self { parts: Vec::new(), naming }
    }

    /// The name of the tensor here.
    fn name(&self) -> String {
        (self.naming)(&self.parts.join("."))
    }
}

macro_rules! track_path {
    () => {
        fn enter_module(&mut self, name: &str, _container_type: &str) {
            self.path.parts.push(name.to_owned());
        }

        fn exit_module(&mut self, _name: &str, _container_type: &str) {
            self.path.parts.pop();
        }
    };
}

struct Reader {
    path: Path,
    tensors: Tensors,
}

impl ModuleVisitor for Reader {
    track_path!();

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.tensors.insert(self.path.name(), param.val().into_data().convert::<f32>());
    }
}

struct Shapes {
    path: Path,
    shapes: BTreeMap<String, Vec<usize>>,
}

impl ModuleVisitor for Shapes {
    track_path!();

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.shapes.insert(self.path.name(), param.lazy_shape().as_slice().to_vec());
    }
}

struct Writer {
    path: Path,
    tensors: Tensors,
}

impl ModuleMapper for Writer {
    track_path!();

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(data) = self.tensors.remove(&self.path.name()) else { return param };
        param.map(|old| {
            let tracked = old.is_require_grad();
            Tensor::from_data(data, &old.device()).set_require_grad(tracked)
        })
    }
}
