//! An upper bound that does not stop learning, and the bound of an output's light by the light of its input.

use super::values;
use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

/// Number of values that one thread processes at a time.
const AT_ONCE: usize = 1 << 15;

/// Largest sRGB code of the linear part of the curve, and the curve's constants (IEC 61966-2-1).
const LINEAR_CODE: f32 = 0.040_45;
const LINEAR_LIGHT: f32 = 0.003_130_8;
const OFFSET: f32 = 0.055;

/// Computes the lesser of `x` and `bound`, two f32 tensors of one shape.
///
/// The gradient of `x` is that of the result where x <= bound. Above the bound, it is that of the result where it is
/// positive, so that a step against the gradient moves x towards the bound, and 0 elsewhere: an output above its bound
/// returns if that helps, and is not pushed further. `bound` gets no gradient.
pub fn bounded(x: &Tensor, bound: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op2(&bound.detach().contiguous()?, Bounded)
}

/// Computes the sRGB codes of `factor` times the light of the sRGB codes `image`, at most 1. The factor 1 keeps codes
/// up to 1 exactly.
pub fn brightened(image: &Tensor, factor: f64) -> Result<Tensor> {
    if factor == 1.0 {
        return image.detach().minimum(1.0);
    }
    let codes: Vec<f32> = image.flatten_all()?.to_vec1()?;
    let scale = libm::pow(factor, 1.0 / 2.4) as f32;
    let codes = codes.into_par_iter().with_min_len(AT_ONCE).map(|code| {
        // Both codes on the power part: 1.055 (f ((c + 0.055) / 1.055)^2.4)^(1 / 2.4) - 0.055.
        let by_power = scale * (code + OFFSET) - OFFSET;
        let light = code / 12.92 * factor as f32;
        let brighter = match (code > LINEAR_CODE, light > LINEAR_LIGHT) {
            (true, _) if by_power > LINEAR_CODE => by_power,
            // A factor below 1 moves the code to the linear part.
            (true, _) => {
                let base = f64::from(code + OFFSET) / 1.055;
                (libm::pow(base, 2.4) * factor * 12.92) as f32
            }
            (false, true) => (1.055 * libm::pow(f64::from(light), 1.0 / 2.4)) as f32 - OFFSET,
            (false, false) => light * 12.92,
        };
        brighter.min(1.0)
    });
    Tensor::from_vec(codes.collect(), image.shape(), image.device())
}

struct Bounded;

impl CustomOp2 for Bounded {
    fn name(&self) -> &'static str {
        "bounded"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        layout: &Layout,
        bound: &CpuStorage,
        bound_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        if layout.dims() != bound_layout.dims() {
            let (x, bound) = (layout.dims(), bound_layout.dims());
            candle_core::bail!("bounded: {x:?} and {bound:?} differ in shape");
        }
        let (x, bound) = (values("bounded", x, layout)?, values("bounded", bound, bound_layout)?);
        // A NaN must propagate.
        let lesser = |(x, bound): (&f32, &f32)| if x > bound { *bound } else { *x };
        let out = x.par_iter().zip(bound).with_min_len(AT_ONCE).map(lesser).collect();
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        bound: &Tensor,
        _result: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let gradient = gradient.contiguous()?;
        Ok((Some(gradient.apply_op3_no_bwd(x, bound, &Gate)?), None))
    }
}

/// Operation that replaces negative gradients by 0 where x exceeds its bound.
struct Gate;

impl CustomOp3 for Gate {
    fn name(&self) -> &'static str {
        "bound-gate"
    }

    fn cpu_fwd(
        &self,
        gradient: &CpuStorage,
        layout: &Layout,
        x: &CpuStorage,
        x_layout: &Layout,
        bound: &CpuStorage,
        bound_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let gradient = values("bounded", gradient, layout)?;
        let (x, bound) = (values("bounded", x, x_layout)?, values("bounded", bound, bound_layout)?);
        let all = gradient.par_iter().zip(x).zip(bound).with_min_len(AT_ONCE);
        let of = |((gradient, x), bound): ((&f32, &f32), &f32)| {
            if x > bound && *gradient < 0.0 { 0.0 } else { *gradient }
        };
        Ok((CpuStorage::F32(all.map(of).collect()), layout.shape().clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};
    use glasshouse_line::color::{decode_srgb, linear_to_srgb};

    #[test]
    fn gradients_above_the_bound_only_pull_towards_it() {
        let x = Var::new(&[0.5f32, 0.5, 0.7, 0.7, 0.6, 0.6], &Device::Cpu).unwrap();
        let bound = Tensor::new(&[0.6f32; 6], &Device::Cpu).unwrap();
        let y = bounded(&x, &bound).unwrap();
        assert_eq!(y.to_vec1::<f32>().unwrap(), [0.5, 0.5, 0.6, 0.6, 0.6, 0.6]);
        let weights = Tensor::new(&[1.0f32, -1.0, 2.0, -2.0, 3.0, -3.0], &Device::Cpu).unwrap();
        let gradients = (y * weights).unwrap().sum_all().unwrap().backward().unwrap();
        let found = gradients.get(&x).unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(found, [1.0, -1.0, 2.0, 0.0, 3.0, -3.0]);
    }

    #[test]
    fn an_output_above_its_bound_returns_to_a_darker_target() {
        let x = Var::new(&[1.5f32], &Device::Cpu).unwrap();
        let bound = Tensor::new(&[0.8f32], &Device::Cpu).unwrap();
        let target = Tensor::new(&[0.3f32], &Device::Cpu).unwrap();
        for _ in 0..400 {
            let loss = (bounded(&x, &bound).unwrap() - &target).unwrap().sqr().unwrap();
            let gradients = loss.backward().unwrap();
            let step = (gradients.get(&x).unwrap() * 0.05).unwrap();
            x.set(&(x.as_tensor() - step).unwrap()).unwrap();
        }
        assert!((x.to_vec1::<f32>().unwrap()[0] - 0.3).abs() < 1e-3);
    }

    #[test]
    fn brightened_codes_have_the_factor_times_the_light() {
        let codes: Vec<f32> = (0..=1000).map(|k| k as f32 / 1000.0).collect();
        let image = Tensor::new(codes.clone(), &Device::Cpu).unwrap();
        for factor in [0.5, 1.0, 1.2, 3.0] {
            let found = brightened(&image, factor).unwrap().to_vec1::<f32>().unwrap();
            for (code, found) in codes.iter().zip(found) {
                let light = decode_srgb(f64::from(*code)) * factor;
                let expected = linear_to_srgb(light as f32).min(1.0);
                let off = (f64::from(found) - expected).abs();
                assert!(off < 2e-6, "{factor} {code}: {found} {expected}");
            }
        }
        assert_eq!(brightened(&image, 1.0).unwrap().to_vec1::<f32>().unwrap(), codes);
    }
}
