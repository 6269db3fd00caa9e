//! `--device` of commands with networks.

use super::exit_code::{Exit, Failure, failure};
use clap::Args as ClapArgs;
use serde::{Serialize, Serializer};
use std::fmt;
use train::candle_core::Device;

/// The option `--device`.
#[derive(Clone, Debug, Default, ClapArgs)]
pub(super) struct DeviceArgs {
    /// Device of the networks: cpu; cuda or cuda:N for the first GPU or GPU N (from 0), with the Cargo feature `cuda`. On a
    /// GPU the last bits differ from run to run
    #[arg(long, value_name = "cpu|cuda[:N]", default_value_t, value_parser = parse)]
    pub(super) device: DeviceName,
}

/// Device that runs the networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum DeviceName {
    /// The CPU, with the threads of `-j`.
    #[default]
    Cpu,
    /// The GPU with this number.
    Cuda(usize),
}

impl DeviceName {
    pub(super) fn open(self) -> Result<Device, Failure> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            Self::Cuda(number) => Device::new_cuda(number).map_err(|e| {
                failure!(
                    Exit::Failed,
                    "cannot use GPU {number} ({e}): see docs/training.md, or leave out --device"
                )
            }),
        }
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
        }
    }
}

impl Serialize for DeviceName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Parses a device. Refuses GPUs if the program was built without them.
fn parse(text: &str) -> Result<DeviceName, String> {
    if text == "cpu" {
        return Ok(DeviceName::Cpu);
    }
    let number = match text {
        "cuda" => Some("0"),
        _ => text.strip_prefix("cuda:"),
    };
    let number = number.filter(|number| number.bytes().all(|byte| byte.is_ascii_digit()));
    let number = number.and_then(|number| number.parse().ok());
    let number = number.ok_or_else(|| "expected cpu, cuda or cuda:N, such as cuda:1".to_owned())?;
    if cfg!(feature = "cuda") {
        Ok(DeviceName::Cuda(number))
    } else {
        Err("this program was built without the Cargo feature `cuda`: build it as docs/training.md describes, or leave \
             out --device"
            .to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_parsed() {
        assert_eq!(parse("cpu"), Ok(DeviceName::Cpu));
        for (text, number) in [("cuda", 0), ("cuda:0", 0), ("cuda:3", 3)] {
            match parse(text) {
                Ok(device) => assert_eq!(device, DeviceName::Cuda(number)),
                Err(error) => assert!(error.contains("Cargo feature `cuda`"), "{error}"),
            }
            assert_eq!(parse(text).is_ok(), cfg!(feature = "cuda"));
        }
        for text in ["", "gpu", "cuda:", "cuda:+1", "cuda:x", "cuda 1", "metal"] {
            assert!(parse(text).unwrap_err().starts_with("expected cpu"), "{text}");
        }
        assert_eq!(DeviceName::Cpu.to_string(), "cpu");
        assert_eq!(DeviceName::Cuda(1).to_string(), "cuda:1");
    }
}
