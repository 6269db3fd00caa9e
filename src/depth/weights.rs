//! Weights by name: those of Hugging Face's `transformers`, and those of the authors' checkpoints.

use super::config::{Config, Model, PATCH_PX};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use train::candle_core::{self, DType, Tensor};

/// Error of a file of weights.
#[derive(Debug, thiserror::Error)]
pub enum WeightError {
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} holds no weights that can be read: {reason}; give a .safetensors or .pth file of Depth Anything V2", path.display())]
    File { path: PathBuf, reason: String },
    #[error("{} lacks the tensor {name}: it is not a Depth Anything V2 of size {model}", path.display())]
    Missing { path: PathBuf, name: String, model: String },
    #[error("{} has the tensor {name} with the shape {found:?} instead of {expected:?}: it is not a Depth Anything V2 of size {model}", path.display())]
    Shape { path: PathBuf, name: String, found: Vec<usize>, expected: Vec<usize>, model: String },
    #[error("{} has the value {value:e} in the tensor {name}, which no trained network has: download the weights again", path.display())]
    Value { path: PathBuf, name: String, value: f32 },
}

/// Bound of weights, far above those of trained networks: values that are not finite, or that make depths without meaning, are
/// beyond it.
const MAX_WEIGHT: f32 = 1e9;

/// Checked tensors of a network, with the names of `transformers`.
#[derive(Clone, Debug)]
pub struct Weights {
    pub(crate) tensors: HashMap<String, Tensor>,
    /// BLAKE3 of the file.
    pub blake3: String,
}

impl Weights {
    /// Reads a file, finds its size if `model` is `None`, and checks names and shapes.
    pub fn read(path: &Path, model: Option<Model>) -> Result<(Self, Model), WeightError> {
        let bytes = render::input_file::read(path)
            .map_err(|source| WeightError::Read { path: path.to_owned(), source })?;
        let file = |reason: String| WeightError::File { path: path.to_owned(), reason };
        let tensors = train::read_weights(path, &bytes).map_err(|e| file(e.to_string()))?;
        let tensors = named_as_transformers(tensors).map_err(|e| file(e.to_string()))?;
        let width = tensors.get("backbone.embeddings.cls_token").map(Tensor::elem_count);
        let of_width = Model::ALL.into_iter().find(|m| Some(m.config().width) == width);
        let Some(model) = model.or(of_width) else {
            return Err(file("no tensor backbone.embeddings.cls_token or pretrained.cls_token with 384, 768 or 1024 numbers".to_owned()));
        };
        let blake3 = blake3::hash(&bytes).to_hex().to_string();
        let weights = Self::checked(tensors, &model.config(), path, model.name(), blake3)?;
        Ok((weights, model))
    }

    /// Checks names and shapes of tensors. `path` and `model` are for messages.
    pub(crate) fn checked(
        mut tensors: HashMap<String, Tensor>,
        config: &Config,
        path: &Path,
        model: &str,
        blake3: String,
    ) -> Result<Self, WeightError> {
        let mut kept = HashMap::new();
        for (name, expected) in shapes(config) {
            let Some(tensor) = tensors.remove(&name) else {
                let (path, model) = (path.to_owned(), model.to_owned());
                return Err(WeightError::Missing { path, name, model });
            };
            if tensor.dims() != expected {
                let (path, model) = (path.to_owned(), model.to_owned());
                let found = tensor.dims().to_vec();
                return Err(WeightError::Shape { path, name, found, expected, model });
            }
            let file = |e: candle_core::Error| WeightError::File {
                path: path.to_owned(),
                reason: e.to_string(),
            };
            let tensor = tensor.to_dtype(DType::F32).map_err(file)?;
            let values = tensor.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(file)?;
            let is_usable = |value: &f32| value.abs() <= MAX_WEIGHT;
            if let Some(&value) = values.iter().find(|value| !is_usable(value)) {
                return Err(WeightError::Value { path: path.to_owned(), name, value });
            }
            kept.insert(name, tensor);
        }
        Ok(Self { tensors: kept, blake3 })
    }

    /// Returns a tensor.
    pub(crate) fn get(&self, name: &str) -> candle_core::Result<Tensor> {
        let tensor = self.tensors.get(name).cloned();
        tensor.ok_or_else(|| candle_core::Error::Msg(format!("no tensor {name}")))
    }
}

/// Lists the names and shapes of all tensors that the network uses.
pub(crate) fn shapes(config: &Config) -> Vec<(String, Vec<usize>)> {
    let Config { width, fused_channels: fused, .. } = *config;
    let tokens = 1 + config.position_side * config.position_side;
    let mut list = Vec::new();
    let mut add = |name: String, shape: &[usize]| list.push((name, shape.to_vec()));
    let embeddings = "backbone.embeddings";
    add(format!("{embeddings}.cls_token"), &[1, 1, width]);
    add(format!("{embeddings}.position_embeddings"), &[1, tokens, width]);
    add(
        format!("{embeddings}.patch_embeddings.projection.weight"),
        &[width, 3, PATCH_PX, PATCH_PX],
    );
    add(format!("{embeddings}.patch_embeddings.projection.bias"), &[width]);
    for block in 0..config.blocks {
        let name = format!("backbone.encoder.layer.{block}");
        for norm in ["norm1", "norm2"] {
            add(format!("{name}.{norm}.weight"), &[width]);
            add(format!("{name}.{norm}.bias"), &[width]);
        }
        for part in ["query", "key", "value"] {
            add(format!("{name}.attention.attention.{part}.weight"), &[width, width]);
            add(format!("{name}.attention.attention.{part}.bias"), &[width]);
        }
        add(format!("{name}.attention.output.dense.weight"), &[width, width]);
        add(format!("{name}.attention.output.dense.bias"), &[width]);
        add(format!("{name}.layer_scale1.lambda1"), &[width]);
        add(format!("{name}.layer_scale2.lambda1"), &[width]);
        add(format!("{name}.mlp.fc1.weight"), &[4 * width, width]);
        add(format!("{name}.mlp.fc1.bias"), &[4 * width]);
        add(format!("{name}.mlp.fc2.weight"), &[width, 4 * width]);
        add(format!("{name}.mlp.fc2.bias"), &[width]);
    }
    add("backbone.layernorm.weight".to_owned(), &[width]);
    add("backbone.layernorm.bias".to_owned(), &[width]);
    for (level, channels) in config.level_channels.into_iter().enumerate() {
        let name = format!("neck.reassemble_stage.layers.{level}");
        add(format!("{name}.projection.weight"), &[channels, width, 1, 1]);
        add(format!("{name}.projection.bias"), &[channels]);
        let side = [4, 2, 0, 3][level];
        if side > 0 {
            add(format!("{name}.resize.weight"), &[channels, channels, side, side]);
            add(format!("{name}.resize.bias"), &[channels]);
        }
        add(format!("neck.convs.{level}.weight"), &[fused, channels, 3, 3]);
        let name = format!("neck.fusion_stage.layers.{level}");
        add(format!("{name}.projection.weight"), &[fused, fused, 1, 1]);
        add(format!("{name}.projection.bias"), &[fused]);
        // The first fused level has nothing to add.
        for unit in if level == 0 { 2..=2 } else { 1..=2 } {
            for convolution in 1..=2 {
                let name = format!("{name}.residual_layer{unit}.convolution{convolution}");
                add(format!("{name}.weight"), &[fused, fused, 3, 3]);
                add(format!("{name}.bias"), &[fused]);
            }
        }
    }
    let last = config.last_channels;
    for (name, out, from, side) in
        [("conv1", fused / 2, fused, 3), ("conv2", last, fused / 2, 3), ("conv3", 1, last, 1)]
    {
        add(format!("head.{name}.weight"), &[out, from, side, side]);
        add(format!("head.{name}.bias"), &[out]);
    }
    list
}

/// Returns the name in the published files of a name that version 5 of `transformers` uses in memory.
fn published_name(name: String) -> String {
    let parts = [
        (".attention.q_proj.", ".attention.attention.query."),
        (".attention.k_proj.", ".attention.attention.key."),
        (".attention.v_proj.", ".attention.attention.value."),
        (".attention.o_proj.", ".attention.output.dense."),
    ];
    parts.into_iter().fold(name, |name, (own, published)| name.replacen(own, published, 1))
}

/// Renames the tensors of the authors' checkpoints, whose queries, keys and values are one tensor.
pub(crate) fn named_as_transformers(
    tensors: HashMap<String, Tensor>,
) -> candle_core::Result<HashMap<String, Tensor>> {
    if !tensors.keys().any(|name| name.starts_with("pretrained.")) {
        return Ok(tensors.into_iter().map(|(name, t)| (published_name(name), t)).collect());
    }
    let mut renamed = HashMap::new();
    for (name, tensor) in tensors {
        let Some((stem, kind)) = name.rsplit_once(".qkv.") else {
            if let Some(own) = own_name(&name) {
                renamed.insert(own, tensor);
            }
            continue;
        };
        let Some(block) = stem.strip_prefix("pretrained.blocks.") else { continue };
        let block = block.trim_end_matches(".attn");
        for (part, tensor) in ["query", "key", "value"].into_iter().zip(tensor.chunk(3, 0)?) {
            let name = format!("backbone.encoder.layer.{block}.attention.attention.{part}.{kind}");
            renamed.insert(name, tensor);
        }
    }
    Ok(renamed)
}

/// Returns the name in `transformers` of a tensor of the authors' checkpoints; `None` for one that nothing uses.
fn own_name(name: &str) -> Option<String> {
    if let Some(rest) = name.strip_prefix("pretrained.") {
        let embeddings = "backbone.embeddings";
        return Some(match rest {
            "cls_token" => format!("{embeddings}.cls_token"),
            "pos_embed" => format!("{embeddings}.position_embeddings"),
            _ if rest.starts_with("patch_embed.proj.") => rest.replacen(
                "patch_embed.proj",
                "backbone.embeddings.patch_embeddings.projection",
                1,
            ),
            _ if rest.starts_with("norm.") => rest.replacen("norm", "backbone.layernorm", 1),
            _ => rest
                .replacen("blocks.", "backbone.encoder.layer.", 1)
                .replacen(".attn.proj.", ".attention.output.dense.", 1)
                .replacen(".ls1.gamma", ".layer_scale1.lambda1", 1)
                .replacen(".ls2.gamma", ".layer_scale2.lambda1", 1),
        });
    }
    let rest = name.strip_prefix("depth_head.")?;
    for (own, theirs) in [("projection", "projects."), ("resize", "resize_layers.")] {
        if let Some(rest) = rest.strip_prefix(theirs) {
            let (level, kind) = rest.split_once('.')?;
            return Some(format!("neck.reassemble_stage.layers.{level}.{own}.{kind}"));
        }
    }
    let rest = rest.strip_prefix("scratch.")?;
    if let Some(rest) = rest.strip_prefix("refinenet") {
        // The authors count from the finest level, `transformers` from the coarsest.
        let (number, rest) = rest.split_once('.')?;
        let level = 4usize.checked_sub(number.parse().ok()?)?;
        let rest = rest
            .replacen("out_conv", "projection", 1)
            .replacen("resConfUnit", "residual_layer", 1)
            .replacen(".conv", ".convolution", 1);
        return Some(format!("neck.fusion_stage.layers.{level}.{rest}"));
    }
    for (own, theirs) in [
        ("neck.convs.0.weight", "layer1_rn.weight"),
        ("neck.convs.1.weight", "layer2_rn.weight"),
        ("neck.convs.2.weight", "layer3_rn.weight"),
        ("neck.convs.3.weight", "layer4_rn.weight"),
        ("head.conv1.weight", "output_conv1.weight"),
        ("head.conv1.bias", "output_conv1.bias"),
        ("head.conv2.weight", "output_conv2.0.weight"),
        ("head.conv2.bias", "output_conv2.0.bias"),
        ("head.conv3.weight", "output_conv2.2.weight"),
        ("head.conv3.bias", "output_conv2.2.bias"),
    ] {
        if rest == theirs {
            return Some(own.to_owned());
        }
    }
    None
}
