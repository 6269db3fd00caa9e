//! Materials of solids: two colours, a pattern, gloss, emission.

use super::pattern::Pattern;
use glam::Vec3;
use std::sync::LazyLock;

/// Linear values of the 256 sRGB codes.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let c = code as f32 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { libm::powf((c + 0.055) / 1.055, 2.4) }
    })
});

/// Converts an sRGB code `0xRRGGBB` to a linear colour.
pub(super) fn color(code: u32) -> Vec3 {
    let channel = |shift: u32| LINEAR[((code >> shift) & 255) as usize];
    Vec3::new(channel(16), channel(8), channel(0))
}

/// Returns a matt material with the sRGB code `0xRRGGBB`.
pub(super) fn plain(code: u32) -> Material {
    Material::plain(color(code))
}

/// Reflectance and emission of a surface, as a pattern of two linear colours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    pub(super) pattern: Pattern,
    pub(super) main: Vec3,
    pub(super) second: Vec3,
    /// Share of mirror reflection at normal incidence; also scales the sun's highlight.
    pub(super) gloss: f32,
    /// Emitted radiance relative to `main` or, in facades and shop fronts, to the colours of the interior.
    pub(super) glow: f32,
    pub(super) seed: i32,
    pub(super) casts_shadow: bool,
}

impl Material {
    /// Creates a matt material of one colour.
    pub(super) fn plain(main: Vec3) -> Self {
        Self {
            pattern: Pattern::Plain,
            main,
            second: main,
            gloss: 0.0,
            glow: 0.0,
            seed: 0,
            casts_shadow: true,
        }
    }

    /// Creates a matt material with a pattern of two colours.
    pub(super) fn new(pattern: Pattern, main: Vec3, second: Vec3, seed: i32) -> Self {
        Self { pattern, second, seed, ..Self::plain(main) }
    }

    /// Creates the material of a lamp shade, which casts no shadow and emits light if `glow` is not 0.
    pub(super) fn lamp(main: Vec3, glow: f32) -> Self {
        Self { glow, casts_shadow: false, ..Self::plain(main) }
    }

    pub(super) fn glossy(self, gloss: f32) -> Self {
        Self { gloss, ..self }
    }
}
