//! DINOv2: a vision transformer with scaled layers, from planes to tokens of four blocks.

use super::config::{Config, PATCH_PX};
use super::ops::{add_scaled, attention, layer_norm, linear, linear_gelu};
use super::position::resized;
use super::weights::Weights;
use train::candle_core::{Result, Tensor};

/// A matrix (in, out) and its bias.
struct Linear {
    weight: Tensor,
    bias: Tensor,
}

struct Norm {
    weight: Tensor,
    bias: Tensor,
}

struct Block {
    norms: [Norm; 2],
    /// Queries, keys and values of all heads.
    qkv: Linear,
    joined: Linear,
    scales: [Tensor; 2],
    mlp: [Linear; 2],
}

pub(crate) struct Encoder {
    class_token: Tensor,
    class_position: Tensor,
    positions: Tensor,
    patches: Linear,
    blocks: Vec<Block>,
    norm: Norm,
    config: Config,
}

impl Encoder {
    pub(crate) fn new(weights: &Weights, config: &Config) -> Result<Self> {
        let get = |name: &str| weights.get(name);
        let linear = |name: &str| {
            Ok::<_, train::candle_core::Error>(Linear {
                weight: get(&format!("{name}.weight"))?.flatten_from(1)?.t()?.contiguous()?,
                bias: get(&format!("{name}.bias"))?,
            })
        };
        let norm = |name: &str| {
            Ok::<_, train::candle_core::Error>(Norm {
                weight: get(&format!("{name}.weight"))?,
                bias: get(&format!("{name}.bias"))?,
            })
        };
        let width = config.width;
        let block = |number: usize| {
            let name = format!("backbone.encoder.layer.{number}");
            let parts =
                ["query", "key", "value"].map(|part| format!("{name}.attention.attention.{part}"));
            let [q, k, v] = [linear(&parts[0])?, linear(&parts[1])?, linear(&parts[2])?];
            Ok::<_, train::candle_core::Error>(Block {
                norms: [norm(&format!("{name}.norm1"))?, norm(&format!("{name}.norm2"))?],
                qkv: Linear {
                    weight: Tensor::cat(&[&q.weight, &k.weight, &v.weight], 1)?,
                    bias: Tensor::cat(&[&q.bias, &k.bias, &v.bias], 0)?,
                },
                joined: linear(&format!("{name}.attention.output.dense"))?,
                scales: [
                    get(&format!("{name}.layer_scale1.lambda1"))?,
                    get(&format!("{name}.layer_scale2.lambda1"))?,
                ],
                mlp: [linear(&format!("{name}.mlp.fc1"))?, linear(&format!("{name}.mlp.fc2"))?],
            })
        };
        let all = get("backbone.embeddings.position_embeddings")?.squeeze(0)?;
        Ok(Self {
            class_token: get("backbone.embeddings.cls_token")?.reshape((1, width))?,
            class_position: all.narrow(0, 0, 1)?,
            positions: all
                .narrow(0, 1, config.position_side * config.position_side)?
                .contiguous()?,
            patches: linear("backbone.embeddings.patch_embeddings.projection")?,
            blocks: (0..config.blocks).map(block).collect::<Result<_>>()?,
            norm: norm("backbone.layernorm")?,
            config: config.clone(),
        })
    }

    /// Encodes planes (3, rows, columns), multiples of a patch. Returns the tokens (patches, width) of the four read blocks,
    /// without the class token.
    pub(crate) fn forward(&self, planes: &Tensor) -> Result<Vec<Tensor>> {
        let (_, rows, columns) = planes.dims3()?;
        let grid = [rows / PATCH_PX, columns / PATCH_PX];
        let patches = planes
            .reshape(&[3, grid[0], PATCH_PX, grid[1], PATCH_PX][..])?
            .permute([1, 3, 0, 2, 4])?
            .contiguous()?
            .reshape((grid[0] * grid[1], 3 * PATCH_PX * PATCH_PX))?;
        let patches = linear(&patches, &self.patches.weight, &self.patches.bias)?;
        let side = self.config.position_side;
        let positions = resized(&self.positions, side, grid)?;
        let class = (&self.class_token + &self.class_position)?;
        let mut tokens = Tensor::cat(&[class, (patches + positions)?], 0)?;
        let mut read = Vec::new();
        for (number, block) in self.blocks.iter().enumerate() {
            tokens = block.forward(&tokens, self.config.heads)?;
            if self.config.read_blocks.contains(&(number + 1)) {
                let normed = layer_norm(&tokens, &self.norm.weight, &self.norm.bias)?;
                read.push(normed.narrow(0, 1, grid[0] * grid[1])?.contiguous()?);
            }
        }
        Ok(read)
    }
}

impl Block {
    fn forward(&self, tokens: &Tensor, heads: usize) -> Result<Tensor> {
        let normed = layer_norm(tokens, &self.norms[0].weight, &self.norms[0].bias)?;
        let qkv = linear(&normed, &self.qkv.weight, &self.qkv.bias)?;
        let seen = attention(&qkv, heads)?;
        let joined = linear(&seen, &self.joined.weight, &self.joined.bias)?;
        let tokens = add_scaled(tokens, &joined, &self.scales[0])?;
        let normed = layer_norm(&tokens, &self.norms[1].weight, &self.norms[1].bias)?;
        let hidden = linear_gelu(&normed, &self.mlp[0].weight, &self.mlp[0].bias)?;
        let out = linear(&hidden, &self.mlp[1].weight, &self.mlp[1].bias)?;
        add_scaled(&tokens, &out, &self.scales[1])
    }
}
