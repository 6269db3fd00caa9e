//! The absolute value.

use candle_core::{Result, Tensor};

/// |x|, whose gradient at 0 is 0, as in PyTorch. candle's is 1 there, which would pull black and clipped pixels aside.
pub fn absolute(x: &Tensor) -> Result<Tensor> {
    // Of x times its sign, taken as a constant, the gradient is the sign.
    x * x.sign()?.detach()
}
