//! The feature network of the settings: none, or VGG-19 with random weights or torchvision's weights from a file.

use super::pickle_scan::scan;
use super::vgg::{VGG_PLACES, VGG_WIDTHS, Vgg, VggError};
use candle_core::{Device, Tensor};
use plan::{FeatureSource, TrainSettings};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Errors of loading the feature network.
#[derive(Debug, thiserror::Error)]
pub enum FeaturesError {
    #[error("these networks use features of a VGG-19 from a file: name it with --features FILE")]
    NoFile,
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} holds no usable VGG-19: {source}", path.display())]
    Weights { path: PathBuf, source: VggError },
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}

/// The feature network, and the digest of its file.
#[derive(Default)]
pub struct Features {
    /// `None` for networks that use only colours.
    pub vgg: Option<Vgg>,
    /// BLAKE3 of the weights file, if the features use one.
    pub blake3: Option<String>,
}

impl Features {
    /// Loads the feature network of `settings`. `file` holds its weights, if the settings need a file.
    pub fn load(settings: &TrainSettings, file: Option<&Path>) -> Result<Self, FeaturesError> {
        let divisor = settings.vgg_divisor;
        match settings.features {
            FeatureSource::None => Ok(Self::default()),
            FeatureSource::Random => {
                Ok(Self { vgg: Some(Vgg::random(settings.seed, divisor)?), blake3: None })
            }
            FeatureSource::File => {
                let path = file.ok_or(FeaturesError::NoFile)?;
                let bytes = render::input_file::read(path)
                    .map_err(|source| FeaturesError::Read { path: path.to_owned(), source })?;
                let vgg = weights(path, &bytes)
                    .map_err(VggError::from)
                    .and_then(|weights| Vgg::new(&weights, divisor))
                    .map_err(|source| FeaturesError::Weights { path: path.to_owned(), source })?;
                Ok(Self { vgg: Some(vgg), blake3: Some(blake3::hash(&bytes).to_hex().to_string()) })
            }
        }
    }
}

/// Reads all tensors of a `.safetensors` file, or of a `.pth` file, whose pickle is checked first.
pub fn read_weights(
    path: &Path,
    bytes: &[u8],
) -> Result<HashMap<String, Tensor>, candle_core::Error> {
    if path.extension().is_some_and(|ending| ending == "safetensors") {
        return candle_core::safetensors::load_buffer(bytes, &Device::Cpu);
    }
    let unusable = |reason: String| candle_core::Error::Msg(reason);
    scan(path).map_err(unusable)?;
    // candle's reader panics on some damaged files.
    let read = || candle_core::pickle::read_all(path).map(|all| all.into_iter().collect());
    std::panic::catch_unwind(read)
        .unwrap_or_else(|_| Err(unusable("its pickle is damaged".to_owned())))
}

fn weights(path: &Path, bytes: &[u8]) -> Result<HashMap<String, Tensor>, candle_core::Error> {
    if path.extension().is_some_and(|ending| ending == "safetensors") {
        return candle_core::safetensors::load_buffer(bytes, &Device::Cpu);
    }
    let unusable = |reason: String| candle_core::Error::Msg(reason);
    scan(path).map_err(unusable)?;
    // candle's reader panics on some damaged files.
    std::panic::catch_unwind(|| read_pth(path))
        .unwrap_or_else(|_| Err(unusable("its pickle is damaged".to_owned())))
}

/// Reads the tensors of the convolutions. Other tensors, such as those of a classifier, may have any size.
fn read_pth(path: &Path) -> Result<HashMap<String, Tensor>, candle_core::Error> {
    let file = candle_core::pickle::PthTensors::new(path, None)?;
    let largest = 9 * VGG_WIDTHS[VGG_WIDTHS.len() - 1].pow(2);
    let mut tensors = HashMap::new();
    for name in VGG_PLACES
        .into_iter()
        .flat_map(|place| ["weight", "bias"].map(|part| format!("features.{place}.{part}")))
    {
        let Some(info) = file.tensor_infos().get(&name) else {
            continue;
        };
        // Checked before candle allocates memory for the tensor.
        let count = info.layout.dims().iter().try_fold(1usize, |n, &side| n.checked_mul(side));
        if count.is_none_or(|count| count > largest) {
            let reason = format!("{name} is {:?}, too large for VGG-19", info.layout.dims());
            return Err(candle_core::Error::Msg(reason));
        }
        tensors.extend(file.get(&name)?.map(|tensor| (name, tensor)));
    }
    Ok(tensors)
}

#[cfg(test)]
mod tests {
    use super::super::pickle_scan::tests::{nested, write_pth};
    use super::*;

    #[test]
    fn hostile_pth_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hostile.pth");
        let settings = TrainSettings { features: FeatureSource::File, ..TrainSettings::default() };
        let refused = |pickle: &[u8]| {
            write_pth(&path, pickle);
            let error = Features::load(&settings, Some(&path)).err().unwrap();
            assert!(error.to_string().contains("hostile.pth"), "{error}");
            error.to_string()
        };
        let error = refused(&nested(1_000_000));
        assert!(error.contains("nests objects more than 64 deep"), "{error}");
        // A call of _rebuild_tensor_v2 without arguments.
        let error = refused(
            b"\x80\x02}X\x11\x00\x00\x00features.0.weightctorch._utils\n_rebuild_tensor_v2\n)Rs.",
        );
        assert!(error.contains("its pickle is damaged"), "{error}");
        let error = refused(b"\x80\x02}.");
        assert!(error.contains("features.0.weight is missing"), "{error}");
    }
}
