//! Depth Anything V2: depth of photographs, with weights of the user's own.
//!
//! ```text
//! weights (file -> tensors by name, checked) -> encoder (DINOv2) -> head (DPT) -> DepthNet::estimate
//! picture (RGB -> normalised planes)            ops (linear layers, norm, attention: faster than candle's)
//! ```
//!
//! Yang, Kang, Huang, Zhao, Xu, Feng and Zhao, "Depth Anything V2", NeurIPS 2024; Oquab et al., "DINOv2", TMLR 2024; Ranftl,
//! Bochkovskiy and Koltun, "Vision transformers for dense prediction", ICCV 2021. Equal to the implementation in PyTorch's
//! `transformers` within rounding (`tests/depth/parity.py`). The weights are not part of the program.

mod config;
mod encoder;
mod head;
mod net;
mod ops;
mod picture;
mod position;
mod weights;

pub use config::{Config, Model};
pub use net::{DepthError, DepthMap, DepthNet};
pub use weights::{WeightError, Weights};

#[cfg(test)]
mod tests;
