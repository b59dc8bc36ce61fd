//! Where to compute, chosen at run time.
//!
//! `flex`, pure Rust on the CPU, is always built. The others are cargo features of the same names; asking for one that is
//! not built says how to build it.

use burn::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The `--device` of the command lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceChoice {
    /// A GPU if one is built in and works, else `flex`.
    #[default]
    Auto,
    /// Pure Rust on the CPU.
    Flex,
    /// The older CPU back end, for comparison.
    Ndarray,
    /// Vulkan, Metal, DirectX or WebGPU.
    Wgpu,
    /// NVIDIA.
    Cuda,
}

/// A device that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// Not one of the names.
    #[error("no device is called `{0}`: use one of auto, flex, ndarray, wgpu, cuda")]
    Unknown(String),
    /// Left out when the program was compiled.
    #[error(
        "this program was built without the `{device}` back end: rebuild it with \
         `cargo run -p {program} --features {device} -- --device {device}`"
    )]
    NotCompiled {
        /// Name of the back end and of its cargo feature.
        device: DeviceChoice,
        /// Package to rebuild.
        program: String,
    },
    /// Built, but it does not work here.
    #[error("the `{device}` device does not work here ({reason}): check its driver, or use --device flex")]
    Broken {
        /// Name of the back end.
        device: DeviceChoice,
        /// What it said.
        reason: String,
    },
}

impl DeviceChoice {
    /// All choices.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Flex, Self::Ndarray, Self::Wgpu, Self::Cuda];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Flex => "flex",
            Self::Ndarray => "ndarray",
            Self::Wgpu => "wgpu",
            Self::Cuda => "cuda",
        }
    }

    /// Whether the back end is built in.
    pub fn is_compiled(self) -> bool {
        !self.openers().is_empty()
    }

    /// [`Self::resolve_for`] the `train` program.
    ///
    /// # Errors
    /// When the device is not built in or does not work.
    pub fn resolve(self) -> Result<Device, DeviceError> {
        self.resolve_for("train")
    }

    /// The device, tried with a small sum; `program` is the package that an error tells to rebuild.
    ///
    /// # Errors
    /// When the device is not built in or does not work.
    pub fn resolve_for(self, program: &str) -> Result<Device, DeviceError> {
        let mut outcome = Err(DeviceError::NotCompiled { device: self, program: program.to_owned() });
        for open in self.openers() {
            outcome = tried(self, open);
            if outcome.is_ok() {
                break;
            }
        }
        outcome
    }

    /// What to try, in order; empty if the back end is not built in.
    ///
    /// `auto` tries hardware GPUs only: a software renderer is slower than `flex` and has to be asked for by name.
    fn openers(self) -> Vec<fn() -> Device> {
        match self {
            Self::Auto => {
                let mut all = Self::Cuda.openers();
                #[cfg(feature = "wgpu")]
                all.extend([(|| Device::wgpu(burn::tensor::DeviceKind::DiscreteGpu(0))) as fn() -> Device, || {
                    Device::wgpu(burn::tensor::DeviceKind::IntegratedGpu(0))
                }]);
                all.push(Device::flex);
                all
            }
            Self::Flex => vec![Device::flex],
            #[cfg(feature = "ndarray")]
            #[allow(deprecated)] // kept for comparison; upstream recommends flex
            Self::Ndarray => vec![Device::ndarray],
            #[cfg(feature = "wgpu")]
            Self::Wgpu => vec![|| Device::wgpu(burn::tensor::DeviceKind::DefaultDevice)],
            #[cfg(feature = "cuda")]
            Self::Cuda => vec![|| Device::cuda(0)],
            #[allow(unreachable_patterns)] // nothing is left when every feature is on
            _ => Vec::new(),
        }
    }
}

/// Opens a device and adds two numbers on it. Back ends report a missing driver by panicking, so panics are caught here.
fn tried(choice: DeviceChoice, open: fn() -> Device) -> Result<Device, DeviceError> {
    let attempt = std::panic::catch_unwind(|| {
        let device = open();
        let sum = Tensor::<1>::from_floats([1.0, 2.0], &device).sum().into_data().iter::<f32>().next();
        (device, sum)
    });
    let broken = |reason: String| Err(DeviceError::Broken { device: choice, reason });
    match attempt {
        Ok((device, Some(3.0))) => Ok(device),
        Ok((_, sum)) => broken(format!("1 + 2 came out as {sum:?}")),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            broken(text.unwrap_or("it panicked").lines().next().unwrap_or_default().to_owned())
        }
    }
}

impl FromStr for DeviceChoice {
    type Err = DeviceError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|choice| choice.name() == name).ok_or_else(|| DeviceError::Unknown(name.to_owned()))
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What a device is called in logs and manifests.
pub fn device_name(device: &Device) -> String {
    format!("{:?}", device.clone().without_autodiff())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_unknown_ones_are_refused() {
        for choice in DeviceChoice::ALL {
            assert_eq!(choice.to_string().parse::<DeviceChoice>().unwrap(), choice);
        }
        let error = "gpu".parse::<DeviceChoice>().unwrap_err();
        assert!(error.to_string().contains("auto, flex, ndarray, wgpu, cuda"), "{error}");
    }

    #[test]
    fn flex_is_always_there() {
        assert!(DeviceChoice::Flex.resolve().is_ok());
        assert!(DeviceChoice::Auto.resolve().is_ok());
        assert!(device_name(&Device::flex()).to_lowercase().contains("flex"), "{}", device_name(&Device::flex()));
    }

    #[cfg(not(feature = "cuda"))]
    #[test]
    fn a_device_that_is_not_built_says_how_to_build_it() {
        let error = DeviceChoice::Cuda.resolve().unwrap_err().to_string();
        assert!(error.contains("cargo run -p train --features cuda -- --device cuda"), "{error}");
        let error = DeviceChoice::Cuda.resolve_for("infer").unwrap_err().to_string();
        assert!(error.contains("cargo run -p infer --features cuda"), "{error}");
    }

    #[test]
    fn a_device_that_panics_is_an_error() {
        let error = tried(DeviceChoice::Wgpu, || panic!("no adapter")).unwrap_err().to_string();
        assert!(error.contains("no adapter") && error.contains("--device flex"), "{error}");
    }
}
