//! Compares results and gradients with those of PyTorch in f64, which `tests/train/ops.py` computes.

use super::reference::{double_and_join, pad_to_multiple, shuffle2, unshuffle2};
use super::*;
use candle_core::{Device, Tensor, Var};
use std::collections::{BTreeMap, HashMap};

type Case = BTreeMap<String, Tensor>;

fn cases(prefix: &str) -> BTreeMap<String, Case> {
    let bytes = include_bytes!("../../../tests/train/ops.safetensors");
    let all: HashMap<String, Tensor> =
        candle_core::safetensors::load_buffer(bytes, &Device::Cpu).unwrap();
    let mut cases: BTreeMap<String, Case> = BTreeMap::new();
    for (name, tensor) in all {
        let (case, part) = name.rsplit_once('.').unwrap();
        if case.starts_with(prefix) {
            cases.entry(case.to_owned()).or_default().insert(part.to_owned(), tensor);
        }
    }
    assert!(!cases.is_empty(), "{prefix}");
    cases
}

/// Returns the norm of the difference, relative to the norm of the expected values.
fn off(found: &Tensor, expected: &Tensor) -> f64 {
    assert_eq!(found.dims(), expected.dims());
    let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let length = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let expected: Vec<f64> = numbers(expected).into_iter().map(f64::from).collect();
    let found = numbers(found).into_iter().map(f64::from);
    let difference: Vec<f64> = found.zip(&expected).map(|(a, b)| a - b).collect();
    length(&difference) / length(&expected).max(1e-30)
}

const CLOSE: f64 = 1e-5;

/// Computes a case and compares its result and every gradient.
fn compare(name: &str, case: &Case, parts: &[&str], compute: impl Fn(&[Tensor]) -> Tensor) {
    let inputs: Vec<Var> = parts.iter().map(|p| Var::from_tensor(&case[*p]).unwrap()).collect();
    let tensors: Vec<Tensor> = inputs.iter().map(|v| v.as_tensor().clone()).collect();
    let y = compute(&tensors);
    assert!(off(&y, &case["y"]) < CLOSE, "{name}: {}", off(&y, &case["y"]));
    let gradients = (y * &case["g"]).unwrap().sum_all().unwrap().backward().unwrap();
    for (part, input) in parts.iter().zip(&inputs) {
        let found = gradients.get(input).unwrap();
        let off = off(found, &case[&format!("d{part}")]);
        assert!(off < CLOSE, "{name}, gradient of {part}: {off}");
    }
}

fn window(name: &str) -> Window {
    let number = |letter: char| {
        let word =
            name.split(' ').find(|w| w.starts_with(letter) && w[1..].parse::<usize>().is_ok());
        word.unwrap()[1..].parse().unwrap()
    };
    Window { padding: number('p'), stride: number('s'), dilation: number('d') }
}

#[test]
fn convolutions_equal_pytorch() {
    for (name, case) in cases("conv") {
        compare(&name, &case, &["x", "w"], |t| conv2d(&t[0], &t[1], window(&name)).unwrap());
    }
}

#[test]
fn bias_and_relu_equal_pytorch() {
    for (name, case) in cases("relu") {
        let window = Window::same(3, 1);
        compare(&name, &case, &["x", "w", "b"], |t| {
            conv2d_bias_leaky(&t[0], &t[1], &t[2], window, 0.0).unwrap()
        });
    }
}

#[test]
fn bias_and_leaky_relu_equal_pytorch() {
    for (name, case) in cases("leaky") {
        let slope = name.split(' ').nth(1).unwrap().parse().unwrap();
        compare(&name, &case, &["x", "w", "b"], |t| {
            conv2d_bias_leaky(&t[0], &t[1], &t[2], Window::same(3, 1), slope).unwrap()
        });
    }
}

#[test]
fn changes_of_size_equal_pytorch() {
    let of = |name: &str| cases(name).remove(name).unwrap();
    let one = |name: &str, op: fn(&Tensor) -> Result<Tensor>| {
        compare(name, &of(name), &["x"], |t| op(&t[0]).unwrap());
    };
    one("mean pool", mean_pool2);
    one("unshuffle", unshuffle2);
    one("shuffle", shuffle2);
    one("pad", |x| pad_to_multiple(x, 8).map(|padded| padded.narrow(3, 0, 16).unwrap()));
    compare("join", &of("join"), &["x", "s"], |t| double_and_join(&t[0], &t[1]).unwrap());
    let case = of("slopes");
    compare("slopes", &case, &["x"], |t| mean_slope_difference(&t[0], &case["t"]).unwrap());
    let odd = Tensor::zeros((1, 2, 5, 6), candle_core::DType::F32, &Device::Cpu).unwrap();
    assert!(mean_pool2(&odd).unwrap_err().to_string().contains("even rows"));
}

#[test]
fn pooling_resizing_norm_and_absolute_value_equal_pytorch() {
    for (name, case) in cases("pool") {
        compare(&name, &case, &["x"], |t| max_pool2(&t[0]).unwrap());
    }
    for (name, case) in cases("resize") {
        let (_, _, rows, columns) = case["y"].dims4().unwrap();
        compare(&name, &case, &["x"], |t| bilinear(&t[0], rows, columns).unwrap());
    }
    for (name, case) in cases("norm") {
        let is_straight = name.ends_with("straight");
        let options = NormOptions {
            epsilon: if is_straight { 1e-5 } else { 1e-3 },
            slope: if is_straight { 1.0 } else { 0.2 },
        };
        compare(&name, &case, &["x", "c"], |t| norm_act(&t[0], &t[1], options).unwrap());
    }
    for (name, case) in cases("absolute") {
        compare(&name, &case, &["x"], |t| absolute(&t[0]).unwrap());
    }
}

#[test]
fn mean_absolute_difference_equals_candle_operations() {
    let case = &cases("conv four 17x16")["conv four 17x16 p1 s2 d1"];
    let image = &case["x"];
    let other = image.affine(0.5, 0.1).unwrap();
    // The first image is the same in both tensors, so its gradient is 0.
    let first = image.narrow(0, 0, 1).unwrap();
    let rest = other.narrow(0, 1, 1).unwrap();
    let other = Tensor::cat(&[&first, &rest], 0).unwrap();
    let of = |op: fn(&Tensor, &Tensor) -> Result<Tensor>| {
        let (a, b) = (Var::from_tensor(image).unwrap(), Var::from_tensor(&other).unwrap());
        let y = op(&a, &b).unwrap();
        let gradients = (&y * 3.0).unwrap().backward().unwrap();
        [y, gradients.get(&a).unwrap().clone(), gradients.get(&b).unwrap().clone()]
    };
    for (ours, plain) in
        of(mean_absolute_difference).iter().zip(&of(reference::mean_absolute_difference))
    {
        assert!(off(ours, plain) < 1e-6);
    }
}

#[test]
fn unused_gradients_are_not_computed() {
    let image = Tensor::ones((1, 2, 5, 5), candle_core::DType::F32, &Device::Cpu).unwrap();
    let kernel = Var::ones((3, 2, 3, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
    let out = conv2d(&image, &kernel, Window::same(3, 1)).unwrap();
    let gradients = out.sum_all().unwrap().backward().unwrap();
    assert!(gradients.get(&image).is_none() && gradients.get(&kernel).is_some());
}

#[test]
fn errors_name_incompatible_shapes() {
    let image = Tensor::zeros((1, 2, 5, 5), candle_core::DType::F32, &Device::Cpu).unwrap();
    let kernel = Tensor::zeros((3, 4, 3, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
    let error = conv2d(&image, &kernel, Window::same(3, 1)).unwrap_err().to_string();
    assert!(
        error.contains("a kernel of [3, 4, 3, 3] does not fit an image of [1, 2, 5, 5]"),
        "{error}"
    );
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = &cases("conv four 17x16")["conv four 17x16 p1 s2 d1"];
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let [x, w] = ["x", "w"].map(|p| Var::from_tensor(&case[p]).unwrap());
            let y = conv2d(&x, &w, window("p1 s2 d1")).unwrap();
            let gradients = y.sqr().unwrap().sum_all().unwrap().backward().unwrap();
            let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            [numbers(&y), numbers(gradients.get(&x).unwrap()), numbers(gradients.get(&w).unwrap())]
        })
    };
    assert_eq!(of(1), of(3));
}
