//! Parity with the implementation in PyTorch's `transformers`: `tests/depth/parity.py` makes the expected outputs.

use super::weights::shapes;
use super::{Config, DepthNet, Model, Weights};
use safetensors::SafeTensors;
use std::collections::HashMap;
use std::path::Path;
use train::candle_core::{Device, Tensor};

/// Numbers from -1 to 1, as those of `parity.py`.
fn uniform(name: &str, count: usize) -> Vec<f32> {
    let mut seed = 2_166_136_261u32;
    for byte in name.bytes() {
        seed = (seed ^ u32::from(byte)).wrapping_mul(16_777_619);
    }
    let number = |k: usize| {
        let mut x = (k as u32).wrapping_mul(0x9e37_79b9).wrapping_add(seed);
        for (shift, factor) in [(16, 0x21f0_aaad), (15, 0x735a_2d97)] {
            x ^= x >> shift;
            x = x.wrapping_mul(factor);
        }
        x ^= x >> 15;
        (f64::from(x >> 8) / 8_388_608.0 - 1.0) as f32
    };
    (0..count).map(number).collect()
}

fn weight(name: &str, shape: &[usize]) -> Vec<f32> {
    let values = uniform(name, shape.iter().product());
    let affine = |offset: f32, factor: f32| values.iter().map(|v| offset + factor * v).collect();
    if name == "head.conv3.bias" {
        return affine(3.0, 0.0);
    }
    if name.ends_with("lambda1") {
        return affine(0.5, 0.25);
    }
    if name.contains("norm") && name.ends_with("weight") {
        return affine(1.0, 0.2);
    }
    let is_embedding =
        name.contains("embeddings.cls_token") || name.contains("position_embeddings");
    if name.ends_with("bias") || is_embedding {
        return affine(0.0, 0.2);
    }
    let mut fan_in: usize = shape[1..].iter().product();
    if name.contains(".resize.weight") && [2, 4].contains(&shape[2]) {
        fan_in = shape[0];
    }
    affine(0.0, (1.7 / (fan_in as f64).sqrt()) as f32)
}

fn tensors(config: &Config) -> HashMap<String, Tensor> {
    let tensor = |(name, shape): (String, Vec<usize>)| {
        let values = weight(&name, &shape);
        (name, Tensor::from_vec(values, shape, &Device::Cpu).unwrap())
    };
    shapes(config).into_iter().map(tensor).collect()
}

fn weights(config: &Config) -> Weights {
    Weights::checked(tensors(config), config, Path::new("w"), "tiny", String::new()).unwrap()
}

fn tiny() -> Config {
    Config {
        width: 48,
        blocks: 4,
        heads: 3,
        read_blocks: [1, 2, 3, 4],
        level_channels: [16, 24, 32, 48],
        fused_channels: 16,
        last_channels: 8,
        position_side: 9,
    }
}

/// Returns the largest relative difference of a case from the output of `transformers`.
fn difference(
    config: &Config,
    name: &str,
    metric_m: Option<f64>,
    [rows, columns]: [usize; 2],
    step: usize,
) -> f32 {
    let file = include_bytes!("../../tests/depth/parity.safetensors");
    let expected = SafeTensors::deserialize(file).unwrap();
    let kind = if metric_m.is_some() { "metric" } else { "relative" };
    let expected = expected.tensor(&format!("{name} {kind} {rows} {columns}")).unwrap();
    let net = DepthNet::new(&weights(config), config, metric_m).unwrap();
    let planes = uniform(&format!("picture {rows} {columns}"), 3 * rows * columns);
    let planes: Vec<f32> = planes.into_iter().map(|v| 2.0 * v).collect();
    let planes = Tensor::from_vec(planes, (3, rows, columns), &Device::Cpu).unwrap();
    let found = net.forward(&planes).unwrap();
    assert_eq!(found.dims(), [rows, columns]);
    let found = found.to_vec2::<f32>().unwrap();
    let width = columns.div_ceil(step);
    let mut worst: f32 = 0.0;
    for (k, bytes) in expected.data().chunks_exact(4).enumerate() {
        let expected = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let found = found[k / width * step][k % width * step];
        assert!(found.is_finite() && expected > 0.0, "{found} {expected}");
        worst = worst.max((found / expected - 1.0).abs());
    }
    worst
}

#[test]
fn small_networks_agree_with_transformers() {
    for (metric_m, size) in
        [(None, [126, 126]), (None, [126, 182]), (None, [98, 70]), (Some(20.0), [154, 112])]
    {
        let worst = difference(&tiny(), "tiny", metric_m, size, 1);
        assert!(worst < 1e-4, "{metric_m:?} {size:?}: {worst:e}");
    }
}

#[test]
fn vits_agrees_with_transformers() {
    let config = Model::Vits.config();
    for (metric_m, size) in [(None, [518, 518]), (Some(80.0), [518, 686]), (None, [574, 518])] {
        let worst = difference(&config, "vits", metric_m, size, 7);
        assert!(worst < 1e-4, "{metric_m:?} {size:?}: {worst:e}");
    }
}

/// A file with the authors' names has the tensors of `transformers`.
#[test]
fn the_authors_names_are_read() {
    let config = tiny();
    let own = tensors(&config);
    let mut theirs = HashMap::new();
    for (name, tensor) in &own {
        if let Some(renamed) = authors_name(name) {
            theirs.insert(renamed, tensor.clone());
        }
    }
    for block in 0..config.blocks {
        for kind in ["weight", "bias"] {
            let part = |part: &str| {
                &own[&format!("backbone.encoder.layer.{block}.attention.attention.{part}.{kind}")]
            };
            let joined = Tensor::cat(&[part("query"), part("key"), part("value")], 0).unwrap();
            theirs.insert(format!("pretrained.blocks.{block}.attn.qkv.{kind}"), joined);
        }
    }
    theirs.insert(
        "pretrained.mask_token".to_owned(),
        Tensor::zeros((1, 48), train::candle_core::DType::F32, &Device::Cpu).unwrap(),
    );
    let renamed = super::weights::named_as_transformers(theirs).unwrap();
    for (name, tensor) in &own {
        let found = renamed.get(name).unwrap_or_else(|| panic!("{name} is missing"));
        let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert!(values(found) == values(tensor), "{name}");
    }
}

/// Returns the name in the authors' checkpoints, written down independently of the reader.
fn authors_name(name: &str) -> Option<String> {
    if name.contains(".attention.attention.") {
        return None;
    }
    let mut found = name.to_owned();
    for (from, to) in [
        ("backbone.embeddings.position_embeddings", "pretrained.pos_embed"),
        ("backbone.embeddings.patch_embeddings.projection", "pretrained.patch_embed.proj"),
        ("backbone.embeddings", "pretrained"),
        ("backbone.encoder.layer", "pretrained.blocks"),
        ("attention.output.dense", "attn.proj"),
        ("layer_scale1.lambda1", "ls1.gamma"),
        ("layer_scale2.lambda1", "ls2.gamma"),
        ("backbone.layernorm", "pretrained.norm"),
        ("neck.convs.0", "depth_head.scratch.layer1_rn"),
        ("neck.convs.1", "depth_head.scratch.layer2_rn"),
        ("neck.convs.2", "depth_head.scratch.layer3_rn"),
        ("neck.convs.3", "depth_head.scratch.layer4_rn"),
        ("head.conv1", "depth_head.scratch.output_conv1"),
        ("head.conv2", "depth_head.scratch.output_conv2.0"),
        ("head.conv3", "depth_head.scratch.output_conv2.2"),
        ("neck.fusion_stage.layers.0", "depth_head.scratch.refinenet4"),
        ("neck.fusion_stage.layers.1", "depth_head.scratch.refinenet3"),
        ("neck.fusion_stage.layers.2", "depth_head.scratch.refinenet2"),
        ("neck.fusion_stage.layers.3", "depth_head.scratch.refinenet1"),
        ("refinenet", "refinenet"),
    ] {
        found = found.replace(from, to);
    }
    if let Some(rest) = found.strip_prefix("neck.reassemble_stage.layers.") {
        let (level, rest) = rest.split_once('.').unwrap();
        let (part, kind) = rest.split_once('.').unwrap();
        let folder = if part == "projection" { "projects" } else { "resize_layers" };
        return Some(format!("depth_head.{folder}.{level}.{kind}"));
    }
    if found.contains("refinenet") {
        found = found
            .replace(".projection.", ".out_conv.")
            .replace("residual_layer", "resConfUnit")
            .replace("convolution", "conv");
    }
    Some(found)
}

#[test]
fn wrong_weights_are_refused_by_name() {
    let config = tiny();
    let check = |change: fn(&mut HashMap<String, Tensor>)| {
        let mut changed = tensors(&config);
        change(&mut changed);
        let path = Path::new("w.pth");
        Weights::checked(changed, &config, path, "tiny", String::new()).unwrap_err().to_string()
    };
    let missing = check(|all| drop(all.remove("head.conv2.bias")));
    assert!(missing.starts_with("w.pth lacks the tensor head.conv2.bias"), "{missing}");
    let shape = check(|all| {
        let wrong = all["head.conv2.bias"].reshape((1, 8)).unwrap();
        all.insert("head.conv2.bias".to_owned(), wrong);
    });
    assert!(shape.contains("head.conv2.bias with the shape [1, 8] instead of [8]"), "{shape}");
    for (value, words) in [(f32::NAN, "NaN"), (f32::NEG_INFINITY, "-inf"), (1e30, "1e30")] {
        let mut changed = tensors(&config);
        let mut values = weight("head.conv2.bias", &[8]);
        values[3] = value;
        let tensor = Tensor::from_vec(values, 8, &Device::Cpu).unwrap();
        changed.insert("head.conv2.bias".to_owned(), tensor);
        let path = Path::new("w.pth");
        let error = Weights::checked(changed, &config, path, "tiny", String::new()).unwrap_err();
        let error = error.to_string();
        let start = format!("w.pth has the value {words} in the tensor head.conv2.bias");
        assert!(error.starts_with(&start), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("w.safetensors");
    render::atomic_file::write(&file, b"nothing").unwrap();
    let error = Weights::read(&file, None).unwrap_err().to_string();
    assert!(error.contains("holds no weights that can be read"), "{error}");
    let error = Weights::read(&folder.path().join("gone.pth"), None).unwrap_err().to_string();
    assert!(error.contains("cannot read"), "{error}");
}

#[test]
fn thin_pictures_are_refused_before_they_need_memory() {
    let config = tiny();
    let net = DepthNet::new(&weights(&config), &config, None).unwrap();
    for (width, height) in [(2000, 1), (1, 2000), (81, 10), (10, 81)] {
        let error = net.estimate(image::RgbImage::new(width, height)).unwrap_err().to_string();
        let start = format!("it has {width} x {height} px");
        assert!(error.starts_with(&start) && error.contains("8 times as long"), "{error}");
    }
    assert_eq!(net.estimate(image::RgbImage::new(10, 30)).unwrap().values.len(), 300);
}
