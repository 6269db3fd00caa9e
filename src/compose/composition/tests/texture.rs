//! Composed examples with textures.

use super::*;

fn textured(seed: u64, change: fn(&mut Composition)) -> Draw {
    let exposure = Exposure::OfTuple;
    let mut settings = Composition { exposure, none_share: 0.0, ..own_light() };
    change(&mut settings);
    draw(&Composition { textured: 1.0, ..settings }, seed)
}

/// Front and reflection change, the input is still their sum, and the target has the front's texture.
#[test]
fn textured_layers_add_up() {
    let (front, back) = (tuple(61), tuple(62));
    for layering in LAYERINGS {
        let make = |draw: &Draw| draw.linear(layering, whole(&front), Some(whole(&back)), SIDE);
        let drawn = textured(8, |_| ());
        let made = make(&drawn);
        let plain = make(&Draw { texture: None, ..drawn.clone() });
        let without = make(&Draw { strength: DrawnStrength::Ratio(0.0), ..drawn.clone() });
        assert_ne!(made.transmission, plain.transmission);
        assert_ne!(made.glass_reflection, plain.glass_reflection);
        let sums = without.input.iter().zip(&made.glass_reflection).zip(&made.input);
        assert!(sums.into_iter().all(|((ahead, reflected), input)| ahead + reflected == *input));
        let DrawnStrength::Ratio(expected) = drawn.strength else { unreachable!() };
        assert!((made.strength / expected - 1.0).abs() < 1e-5, "{} {expected}", made.strength);
        // F is a share of T, rounded to half floats in tuples, and the texture is that of T.
        let share = |at: usize| without.input[at] / made.transmission[at];
        let expected = if layering.is_mixture() { drawn.transmitted as f32 } else { 0.9 };
        assert!((0..made.input.len()).all(|at| (share(at) / expected - 1.0).abs() < 0.01));
    }
}

/// An example of one tuple without other draws is not the stored one, and a texture never changes the mean much.
#[test]
fn textures_keep_the_light() {
    let front = tuple(63);
    let off = draw(&Composition::off(), 1);
    let mut ratios = 0.0;
    for seed in 0..60 {
        let texture = Some(DrawnTexture { seed, sigma: [0.2; 2] });
        let drawn = Draw { texture, ..off.clone() };
        assert!(!drawn.changes_nothing());
        let made = drawn.linear(Layering::Rendered, whole(&front), None, SIDE);
        let plain = off.linear(Layering::Rendered, whole(&front), None, SIDE);
        let ratio = luminance_of(&made.input) / luminance_of(&plain.input);
        assert!((ratio - 1.0).abs() < 0.2, "{seed}: {ratio}");
        ratios += ratio / 60.0;
    }
    assert!((ratios - 1.0).abs() < 0.02, "{ratios}");
}

/// Equal bits on every machine.
#[test]
fn bits_of_textures_do_not_change() {
    let mut hasher = blake3::Hasher::new();
    for (seed, layering) in (5..).zip(LAYERINGS) {
        let drawn = textured(seed, |settings| settings.camera.jpeg_share = 0.0);
        let (front, back) = (tuple(seed), tuple(seed + 1));
        let made = example(&drawn, layering, whole(&front), Some(whole(&back)));
        for layer in [&made.input, &made.transmission, &made.glass_reflection] {
            for value in layer {
                hasher.update(&value.to_le_bytes());
            }
        }
    }
    assert_eq!(&hasher.finalize().to_hex()[..16], "d0b345f08c1351c0");
}
