//! How exactly the weights of a file are stored.

use super::tensors::Tensors;
use burn::tensor::DType;
use std::fmt;
use std::str::FromStr;

/// The kernels of convolutions, which are nearly all of a file; they are computed with in single precision either way. All
/// else keeps single precision: a running variance of raw counts is beyond what 16 bits of the first kind hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32 bits, as trained.
    #[default]
    F32,
    /// 16 bits, 11 of them precision, up to 65,504.
    F16,
    /// 16 bits, 8 of them precision, the range of 32 bits.
    Bf16,
}

impl Precision {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::F32, Self::F16, Self::Bf16];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::Bf16 => "bf16",
        }
    }

    /// The tensors as they are to be stored, or the name of the first that does not fit.
    pub(super) fn store(self, tensors: Tensors) -> Result<Tensors, String> {
        let dtype = match self {
            Self::F32 => return Ok(tensors),
            Self::F16 => DType::F16,
            Self::Bf16 => DType::BF16,
        };
        let store = |(name, data): (String, burn::tensor::TensorData)| {
            if data.shape().len() != 4 {
                return Ok((name, data));
            }
            let was_finite = data.iter::<f32>().all(f32::is_finite);
            let stored = data.convert_dtype(dtype);
            match was_finite && !stored.iter::<f32>().all(f32::is_finite) {
                true => Err(name),
                false => Ok((name, stored)),
            }
        };
        tensors.into_iter().map(store).collect()
    }
}

/// A name that is none.
#[derive(Debug, thiserror::Error)]
#[error("no precision is called `{0}`: use f32, f16 or bf16")]
pub struct UnknownPrecision(String);

impl FromStr for Precision {
    type Err = UnknownPrecision;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|precision| precision.name() == name)
            .ok_or_else(|| UnknownPrecision(name.to_owned()))
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
