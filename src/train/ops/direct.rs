//! 3 x 3 convolutions of one image with padding 1, and the gradients of their kernels, without unfolding.
//!
//! Images have their channels next to each other, padded to a multiple of 16, and a border of zeros of 1 px. Every result
//! is one chain of fused multiply-adds in a fixed order, so its bits depend neither on the CPU nor on threads.
#![allow(
    unsafe_code,
    reason = "functions compiled for AVX2 and AVX-512, with pointers in inner loops"
)]

use super::buffers::Buffers;
use super::image::{Image, Kernel};
#[cfg(target_arch = "x86_64")]
use super::lanes::{Avx2, Avx512};
use super::lanes::{LANES, Lanes, Plain};
use rayon::prelude::*;
use std::ops::Range;

/// Number of rows that one thread convolves at a time.
const ROWS_AT_ONCE: usize = 32;

/// Least number of pixels of an image whose part of a kernel's gradient is summed at a time.
const PIXELS_AT_ONCE: usize = 64;

/// Convolves an image, adds the bias of each output channel, and multiplies negative results by `slope`, from 0 to 1.
pub(crate) fn convolve(
    image: &Image,
    kernel: &Kernel,
    bias: &[f32],
    slope: f32,
    buffers: &Buffers,
) -> Image {
    let mut out = Image::unwritten(image.rows, image.columns, kernel.outputs, buffers);
    image.check();
    kernel.check();
    assert!(image.channels == kernel.inputs && bias.len() == kernel.outputs, "wrong channels");
    let call = Call { image, kernel, bias, slope };
    let stride = out.stride();
    let rows = &mut out.values[stride..stride * (image.rows + 1)];
    rows.par_chunks_mut(ROWS_AT_ONCE * stride.max(1)).enumerate().for_each(|(part, values)| {
        convolve_rows(call, ROWS_AT_ONCE * part, values);
    });
    out
}

/// Convolves the rows of `out` from `first_row` on, with their borders.
fn convolve_rows(call: Call, first_row: usize, out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            // SAFETY: the CPU has AVX-512, and `convolve` has checked the sizes.
            unsafe { convolve_avx512(call, first_row, out) };
            return;
        }
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            // SAFETY: the CPU has AVX2 and FMA, and `convolve` has checked the sizes.
            unsafe { convolve_avx2(call, first_row, out) };
            return;
        }
    }
    // SAFETY: `convolve` has checked the sizes.
    unsafe { convolve_by::<Plain>(call, first_row, out) };
}

/// Adds the gradient of a kernel: the sum of its input pixels, weighted with the result's gradient.
pub(crate) fn add_kernel_gradient(image: &Image, gradient: &Image, sum: &mut Kernel) {
    image.check();
    gradient.check();
    sum.check();
    let is_same = [image.rows, image.columns] == [gradient.rows, gradient.columns];
    assert!(is_same, "images of two sizes");
    assert!(image.channels == sum.inputs && gradient.channels == sum.outputs, "wrong channels");
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            // SAFETY: the CPU has AVX-512, and the sizes are checked above.
            unsafe { gradient_avx512(image, gradient, sum) };
            return;
        }
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            // SAFETY: the CPU has AVX2 and FMA, and the sizes are checked above.
            unsafe { gradient_avx2(image, gradient, sum) };
            return;
        }
    }
    // SAFETY: the sizes are checked above.
    unsafe { gradient_by::<Plain>(image, gradient, sum) };
}

/// Arguments of a convolution.
#[derive(Clone, Copy)]
struct Call<'a> {
    image: &'a Image,
    kernel: &'a Kernel,
    bias: &'a [f32],
    slope: f32,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn convolve_avx512(call: Call, first_row: usize, out: &mut [f32]) {
    // SAFETY: the caller keeps the rules of `convolve_by`.
    unsafe { convolve_by::<Avx512>(call, first_row, out) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn convolve_avx2(call: Call, first_row: usize, out: &mut [f32]) {
    // SAFETY: the caller keeps the rules of `convolve_by`.
    unsafe { convolve_by::<Avx2>(call, first_row, out) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn gradient_avx512(image: &Image, gradient: &Image, sum: &mut Kernel) {
    // SAFETY: the caller keeps the rules of `gradient_by`.
    unsafe { gradient_by::<Avx512>(image, gradient, sum) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn gradient_avx2(image: &Image, gradient: &Image, sum: &mut Kernel) {
    // SAFETY: the caller keeps the rules of `gradient_by`.
    unsafe { gradient_by::<Avx2>(image, gradient, sum) }
}

/// Returns the number of vectors to process together of `left`.
#[inline(always)]
fn vectors<L: Lanes>(left: usize) -> usize {
    match left {
        _ if !L::IS_WIDE => 1,
        5 => 3,
        left => left.min(4),
    }
}

/// Convolves with one set of instructions. The sizes must fit, and the CPU must have the instructions.
#[inline(always)]
unsafe fn convolve_by<L: Lanes>(call: Call, first_row: usize, out: &mut [f32]) {
    let outputs = call.kernel.outputs;
    let stride = (call.image.columns + 2) * outputs;
    let mut first = 0;
    while first < outputs {
        let count = vectors::<L>((outputs - first) / LANES);
        for (row, out) in out.chunks_exact_mut(stride).enumerate() {
            let row = first_row + row;
            // SAFETY: `first` and `count` vectors of channels are inside the image, and so is the row.
            unsafe {
                match count {
                    1 if L::IS_WIDE => one_row::<L, 16, 1>(call, row, first, out),
                    1 => one_row::<L, 6, 1>(call, row, first, out),
                    2 => one_row::<L, 8, 2>(call, row, first, out),
                    3 => one_row::<L, 8, 3>(call, row, first, out),
                    _ => one_row::<L, 4, 4>(call, row, first, out),
                }
            }
        }
        first += count * LANES;
    }
}

/// Convolves a row for `C` vectors of output channels, `P` pixels at a time, and then four, two and one at a time.
#[inline(always)]
unsafe fn one_row<L: Lanes, const P: usize, const C: usize>(
    call: Call,
    row: usize,
    first: usize,
    out: &mut [f32],
) {
    let mut column = 0;
    // SAFETY: the pixels are inside the row.
    unsafe {
        while column + P <= call.image.columns {
            pixels::<L, P, C>(call, [row, column], first, out);
            column += P;
        }
        while column + 4 <= call.image.columns {
            pixels::<L, 4, C>(call, [row, column], first, out);
            column += 4;
        }
        while column + 2 <= call.image.columns {
            pixels::<L, 2, C>(call, [row, column], first, out);
            column += 2;
        }
        if column < call.image.columns {
            pixels::<L, 1, C>(call, [row, column], first, out);
        }
    }
}

#[inline(always)]
unsafe fn pixels<L: Lanes, const P: usize, const C: usize>(
    Call { image, kernel, bias, slope }: Call,
    [row, column]: [usize; 2],
    first: usize,
    out: &mut [f32],
) {
    let (inputs, outputs) = (kernel.inputs, kernel.outputs);
    // SAFETY: images have a border of 1 px, so the 3 x 3 px around each pixel are inside; `first` and `C` vectors of
    // outputs are inside kernel, bias and result.
    unsafe {
        let mut sums = [[L::splat(0.0); C]; P];
        for sums in &mut sums {
            for (c, sum) in sums.iter_mut().enumerate() {
                *sum = L::load(bias.as_ptr().add(first + c * LANES));
            }
        }
        for y in 0..3 {
            for x in 0..3 {
                let from = image.values.as_ptr();
                let from = from.add((row + y) * image.stride() + (column + x) * inputs);
                let weights = kernel.values.as_ptr().add(kernel.at(y * 3 + x, 0, first));
                for input in 0..kernel.used_inputs {
                    let mut vectors = [L::splat(0.0); C];
                    for (c, vector) in vectors.iter_mut().enumerate() {
                        *vector = L::load(weights.add((c * 9 * inputs + input) * LANES));
                    }
                    for (p, sums) in sums.iter_mut().enumerate() {
                        let value = L::splat(*from.add(p * inputs + input));
                        for (sum, vector) in sums.iter_mut().zip(&vectors) {
                            *sum = L::fma(value, *vector, *sum);
                        }
                    }
                }
            }
        }
        let to = out.as_mut_ptr().add((column + 1) * outputs + first);
        for (p, sums) in sums.iter().enumerate() {
            for (c, sum) in sums.iter().enumerate() {
                L::store(to.add(p * outputs + c * LANES), L::leaky(*sum, slope));
            }
        }
    }
}

/// Adds a kernel's gradient with one set of instructions. The sizes must fit, and the CPU must have the instructions.
///
/// A few rows at a time stay in the cache for all inputs, outputs and places of the kernel.
#[inline(always)]
unsafe fn gradient_by<L: Lanes>(image: &Image, gradient: &Image, sum: &mut Kernel) {
    let at_once = PIXELS_AT_ONCE.div_ceil(gradient.columns.max(1));
    for first in (0..gradient.rows).step_by(at_once) {
        let rows = first..(first + at_once).min(gradient.rows);
        for output in (0..sum.outputs).step_by(LANES) {
            for place in 0..9 {
                let mut input = 0;
                // SAFETY: the rows are inside the image; the place, the vector of outputs and all inputs, which are padded to a
                // multiple of 16, are inside the kernel.
                unsafe {
                    while input < sum.used_inputs {
                        let at = [place, input, output];
                        // Without wide registers, 16 inputs are blocks of six, six and four.
                        input += match input % 16 {
                            _ if L::IS_WIDE => inputs::<L, 16>(image, gradient, &rows, sum, at),
                            12 => inputs::<L, 4>(image, gradient, &rows, sum, at),
                            _ => inputs::<L, 6>(image, gradient, &rows, sum, at),
                        };
                    }
                }
            }
        }
    }
}

/// Adds the gradient for `B` inputs and a vector of outputs at a place of the kernel, and returns `B`.
#[inline(always)]
unsafe fn inputs<L: Lanes, const B: usize>(
    image: &Image,
    gradient: &Image,
    rows: &Range<usize>,
    sum: &mut Kernel,
    [place, input, output]: [usize; 3],
) -> usize {
    let (inputs, outputs) = (sum.inputs, sum.outputs);
    // SAFETY: images have a border of 1 px, so the pixels at every place of the kernel are inside.
    unsafe {
        let total = sum.values.as_mut_ptr().add(sum.at(place, input, output));
        let mut sums = [L::splat(0.0); B];
        for (b, sum) in sums.iter_mut().enumerate() {
            *sum = L::load(total.add(b * LANES));
        }
        for row in rows.clone() {
            let from = image.values.as_ptr();
            let from = from.add((row + place / 3) * image.stride() + place % 3 * inputs + input);
            let given = gradient.values.as_ptr();
            let given = given.add((row + 1) * gradient.stride() + outputs + output);
            for column in 0..gradient.columns {
                let vector = L::load(given.add(column * outputs));
                for (b, sum) in sums.iter_mut().enumerate() {
                    *sum = L::fma(L::splat(*from.add(column * inputs + b)), vector, *sum);
                }
            }
        }
        for (b, sum) in sums.iter().enumerate() {
            L::store(total.add(b * LANES), *sum);
        }
    }
    B
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Stream;
    use crate::ops::{Window, conv2d_bias_leaky};
    use candle_core::{Device, Tensor, Var};

    fn noise(name: &str, count: usize) -> Vec<f32> {
        let mut stream = Stream::new(1, name);
        (0..count).map(|_| stream.normal() as f32).collect()
    }

    /// Returns an image of normal numbers.
    fn image(name: &str, [rows, columns]: [usize; 2], channels: usize) -> Image {
        let mut image = Image::zeros(rows, columns, channels, &Buffers::default());
        let padded = image.channels;
        for row in 0..rows {
            let values = noise(&format!("{name} {row}"), columns * channels);
            let pixels = image.row_mut(row).chunks_exact_mut(padded);
            for (pixel, values) in pixels.zip(values.chunks_exact(channels)) {
                pixel[..channels].copy_from_slice(values);
            }
        }
        image
    }

    #[test]
    fn every_set_of_instructions_has_the_same_bits() {
        let cases = [([3, 21], 16, 80), ([5, 4], 32, 112), ([2, 9], 48, 16), ([4, 15], 12, 32)];
        for (size, inputs, outputs) in cases {
            let (given, gradient) = (image("x", size, inputs), image("g", size, outputs));
            let mut kernel = Kernel::zeros(inputs, outputs);
            kernel.values = noise("kernel", kernel.values.len());
            let bias = noise("bias", outputs);
            let found = convolve(&given, &kernel, &bias, 0.1, &Buffers::default());
            let mut total = kernel.clone();
            add_kernel_gradient(&given, &gradient, &mut total);
            let call = Call { image: &given, kernel: &kernel, bias: &bias, slope: 0.1 };
            let black = || Image::zeros(size[0], size[1], outputs, &Buffers::default());
            let stride = found.stride();
            let inside = stride..stride * (size[0] + 1);
            let (mut plain, mut sum) = (black(), kernel.clone());
            // SAFETY: the sizes are those of `convolve` and `add_kernel_gradient`, which check them.
            unsafe {
                convolve_by::<Plain>(call, 0, &mut plain.values[inside.clone()]);
                gradient_by::<Plain>(&given, &gradient, &mut sum);
            }
            assert!(found.values == plain.values && total.values == sum.values);
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("fma")
            {
                let (mut avx2, mut sum) = (black(), kernel.clone());
                // SAFETY: the CPU has the instructions, and the sizes are as above.
                unsafe {
                    convolve_avx2(call, 0, &mut avx2.values[inside]);
                    gradient_avx2(&given, &gradient, &mut sum);
                }
                assert!(found.values == avx2.values && total.values == sum.values);
            }
        }
    }

    /// Returns the used channels of an image as a tensor (1, channels, rows, columns).
    fn tensor(image: &Image, channels: usize) -> Tensor {
        let pixels = (0..image.rows).flat_map(|row| image.row(row).to_vec()).collect();
        let shape = (1, image.rows, image.columns, image.channels);
        let pixels = Tensor::from_vec(pixels, shape, &Device::Cpu).unwrap();
        pixels.narrow(3, 0, channels).unwrap().permute((0, 3, 1, 2)).unwrap().contiguous().unwrap()
    }

    #[test]
    fn results_and_gradients_equal_those_of_the_general_convolution() {
        // 7 columns have blocks of four, two and one pixels; nine rows of seven are more than are summed at a time.
        for (size, inputs, outputs) in [([11, 7], 12, 32), ([9, 13], 28, 16)] {
            let (given, gradient) = (image("x", size, inputs), image("g", size, outputs));
            let mut kernel = Kernel::zeros(inputs, outputs);
            let weights = noise("weights", 9 * inputs * outputs);
            let mut each = weights.iter();
            for output in 0..outputs {
                for input in 0..inputs {
                    for pixel in (0..9).map(|place| [place / 3, place % 3]) {
                        let place = kernel.index(pixel, input, output);
                        kernel.values[place] = *each.next().unwrap();
                    }
                }
            }
            let bias = noise("bias", outputs);
            let weights = Tensor::from_vec(weights, (outputs, inputs, 3, 3), &Device::Cpu).unwrap();
            let weights = Var::from_tensor(&weights).unwrap();
            let of_bias = Tensor::new(bias.as_slice(), &Device::Cpu).unwrap();
            let expected = conv2d_bias_leaky(
                &tensor(&given, inputs),
                weights.as_tensor(),
                &of_bias,
                Window::same(3, 1),
                1.0,
            )
            .unwrap();
            let near = |found: Vec<f32>, expected: Vec<f32>| {
                assert_eq!(found.len(), expected.len());
                found.iter().zip(&expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-4));
            };
            let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            let found = convolve(&given, &kernel, &bias, 1.0, &Buffers::default());
            near(numbers(&tensor(&found, outputs)), numbers(&expected));
            let loss = (&expected * tensor(&gradient, outputs)).unwrap().sum_all().unwrap();
            let of_weights = loss.backward().unwrap();
            let mut sum = Kernel::zeros(inputs, outputs);
            add_kernel_gradient(&given, &gradient, &mut sum);
            let places = (0..outputs).flat_map(|output| {
                (0..inputs).flat_map(move |input| (0..9).map(move |place| (place, input, output)))
            });
            let found = places.map(|(place, input, output)| {
                sum.values[sum.index([place / 3, place % 3], input, output)]
            });
            near(found.collect(), numbers(of_weights.get(&weights).unwrap()));
        }
    }
}
