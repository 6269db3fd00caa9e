//! Sizes of the published networks.

use std::fmt;

/// A published size of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// 24.8 million numbers.
    Vits,
    /// 97.5 million.
    Vitb,
    /// 335.3 million.
    Vitl,
}

/// Sizes of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Numbers of a token.
    pub width: usize,
    /// Blocks of the encoder.
    pub blocks: usize,
    /// Heads of the attention; they share the width.
    pub heads: usize,
    /// Blocks whose tokens the head reads, counted from 1.
    pub read_blocks: [usize; 4],
    /// Channels of the four levels.
    pub level_channels: [usize; 4],
    /// Channels of the fused levels.
    pub fused_channels: usize,
    /// Channels before the last convolution.
    pub last_channels: usize,
    /// Side of the trained position embedding, patches.
    pub position_side: usize,
}

impl Config {
    /// Lists the names, as in `transformers`, and shapes of all tensors that the network uses.
    pub fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        super::weights::shapes(self)
    }
}

/// Side of a patch, px.
pub(crate) const PATCH_PX: usize = 14;

impl Model {
    pub const ALL: [Self; 3] = [Self::Vits, Self::Vitb, Self::Vitl];

    pub fn name(self) -> &'static str {
        match self {
            Self::Vits => "vits",
            Self::Vitb => "vitb",
            Self::Vitl => "vitl",
        }
    }

    /// Returns the sizes of the network.
    pub fn config(self) -> Config {
        let (width, blocks, heads, fused_channels) = match self {
            Self::Vits => (384, 12, 6, 64),
            Self::Vitb => (768, 12, 12, 128),
            Self::Vitl => (1024, 24, 16, 256),
        };
        Config {
            width,
            blocks,
            heads,
            read_blocks: if blocks == 24 { [5, 12, 18, 24] } else { [3, 6, 9, 12] },
            level_channels: match self {
                Self::Vits => [48, 96, 192, 384],
                Self::Vitb => [96, 192, 384, 768],
                Self::Vitl => [256, 512, 1024, 1024],
            },
            fused_channels,
            last_channels: 32,
            position_side: 37,
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
