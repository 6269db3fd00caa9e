//! Pictures of what stands in the way of a window: photographers, blinds, curtains and plants, with transparent surroundings.
//!
//! Shapes are painted one over the other. A shape is a signed distance in heights of the picture, so that an edge covers the
//! share of a pixel on its inner side. The seed determines every byte, as for photographs.

use super::noise::noise2;
use super::random::Stream;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Kind of a cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CoverKind {
    /// A person with a camera or a telephone, behind the lens.
    Photographer,
    /// Horizontal slats and their cords.
    Blind,
    /// A cloth with folds, opaque or sheer.
    Curtain,
    /// Leaves on stems, in a pot.
    Plant,
}

/// Row of the camera in the pictures of photographers, in heights from the upper edge; their column is the middle.
pub const CAMERA_ROW: f32 = 0.2;

/// A picture of sRGB codes and alpha (not premultiplied), row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CoverPicture {
    pub width: u32,
    pub height: u32,
    pub rgba: Vec<u8>,
}

impl CoverKind {
    /// All kinds, in order.
    pub const ALL: [Self; 4] = [Self::Photographer, Self::Blind, Self::Curtain, Self::Plant];

    /// Returns the name in recipes and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Photographer => "photographer",
            Self::Blind => "blind",
            Self::Curtain => "curtain",
            Self::Plant => "plant",
        }
    }

    /// Returns the width over the height of its pictures.
    pub const fn aspect(self) -> f32 {
        match self {
            Self::Photographer => 0.8,
            Self::Blind => 1.25,
            Self::Curtain => 0.6,
            Self::Plant => 0.75,
        }
    }
}

/// Makes the picture of a cover, `height` px high.
pub fn cover(kind: CoverKind, seed: u64, height: u32) -> CoverPicture {
    let mut stream = Stream::new(&[seed, kind as u64, 0x6376]);
    let mut canvas = Canvas::new(kind.aspect(), height);
    match kind {
        CoverKind::Photographer => photographer(&mut canvas, &mut stream),
        CoverKind::Blind => blind(&mut canvas, &mut stream),
        CoverKind::Curtain => curtain(&mut canvas, &mut stream),
        CoverKind::Plant => plant(&mut canvas, &mut stream),
    }
    canvas.finish()
}

/// Encodes [`cover`] as PNG.
pub fn cover_png(kind: CoverKind, seed: u64, height: u32) -> Result<Vec<u8>, image::ImageError> {
    let picture = cover(kind, seed, height);
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&picture.rgba, picture.width, picture.height, ExtendedColorType::Rgba8)
        .map(|()| bytes)
}

/// A picture in progress: x runs from 0 to the aspect, y from 0 (top) to 1.
struct Canvas {
    width: u32,
    height: u32,
    /// Codes from 0 to 1 times alpha, and alpha.
    pixels: Vec<[f32; 4]>,
}

/// A point of the canvas.
type Point = [f32; 2];

impl Canvas {
    fn new(aspect: f32, height: u32) -> Self {
        let height = height.max(1);
        let width = ((height as f32 * aspect + 0.5) as u32).max(1);
        Self { width, height, pixels: vec![[0.0; 4]; (width * height) as usize] }
    }

    /// Paints a shape: `paint` returns the signed distance (negative inside), the colour and the opacity at a point.
    fn paint(&mut self, paint: impl Fn(Point) -> (f32, [f32; 3], f32)) {
        let side = 1.0 / self.height as f32;
        for y in 0..self.height {
            for x in 0..self.width {
                let at = [(x as f32 + 0.5) * side, (y as f32 + 0.5) * side];
                let (distance, colour, opacity) = paint(at);
                let alpha = opacity * (0.5 - distance / side).clamp(0.0, 1.0);
                if alpha > 0.0 {
                    let pixel = &mut self.pixels[(y * self.width + x) as usize];
                    for c in 0..3 {
                        pixel[c] = colour[c] * alpha + (1.0 - alpha) * pixel[c];
                    }
                    pixel[3] = alpha + (1.0 - alpha) * pixel[3];
                }
            }
        }
    }

    /// Paints an opaque shape of one colour, with a weak pattern of cloth or skin.
    fn fill(&mut self, colour: [f32; 3], seed: i32, distance: impl Fn(Point) -> f32) {
        self.paint(|at| {
            let shade = 0.85 + 0.3 * noise2(at[0] * 40.0, at[1] * 25.0, seed);
            (distance(at), colour.map(|v| v * shade), 1.0)
        });
    }

    fn finish(self) -> CoverPicture {
        let code = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        let of = |[r, g, b, alpha]: &[f32; 4]| {
            let straight = |v: f32| code(if *alpha > 0.0 { v / alpha } else { 0.0 });
            [straight(*r), straight(*g), straight(*b), code(*alpha)]
        };
        let rgba = self.pixels.iter().flat_map(of).collect();
        CoverPicture { width: self.width, height: self.height, rgba }
    }
}

/// Returns the distance from an ellipse, approximately.
fn ellipse([x, y]: Point, [cx, cy]: Point, [rx, ry]: [f32; 2]) -> f32 {
    let (u, v) = ((x - cx) / rx, (y - cy) / ry);
    ((u * u + v * v).sqrt() - 1.0) * rx.min(ry)
}

/// Returns the distance from a line segment with round ends, whose radius runs from `r0` to `r1`.
fn limb([x, y]: Point, [ax, ay]: Point, [bx, by]: Point, [r0, r1]: [f32; 2]) -> f32 {
    let (dx, dy) = (bx - ax, by - ay);
    let along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy).max(1e-9);
    let t = along.clamp(0.0, 1.0);
    let (px, py) = (x - ax - t * dx, y - ay - t * dy);
    (px * px + py * py).sqrt() - (r0 + (r1 - r0) * t)
}

/// Returns the distance from a rectangle with round corners.
fn rounded([x, y]: Point, [cx, cy]: Point, [hx, hy]: [f32; 2], radius: f32) -> f32 {
    let (u, v) = ((x - cx).abs() - hx + radius, (y - cy).abs() - hy + radius);
    let outside = (u.max(0.0) * u.max(0.0) + v.max(0.0) * v.max(0.0)).sqrt();
    outside + u.max(v).min(0.0) - radius
}

/// Draws a colour around a grey value.
fn tint(stream: &mut Stream, grey: f32, spread: f32) -> [f32; 3] {
    [0; 3].map(|_| (grey + spread * (stream.unit() - 0.5)).clamp(0.02, 1.0))
}

fn photographer(canvas: &mut Canvas, stream: &mut Stream) {
    let middle = 0.5 * CoverKind::Photographer.aspect() + stream.range(-0.03, 0.03);
    let (skin, cloth, hair) = {
        let tone = stream.range(0.25, 0.85);
        let (grey, brown) = (stream.range(0.05, 0.6), stream.range(0.06, 0.4));
        let hair = [brown, brown * 0.78, brown * 0.6];
        ([tone, tone * 0.8, tone * 0.68], tint(stream, grey, 0.3), hair)
    };
    let (seed, head_y) = (stream.seed(), stream.range(0.16, 0.2));
    let (width, shoulder_y) = (stream.range(0.15, 0.2), head_y + stream.range(0.17, 0.2));
    let reach = stream.range(0.24, 0.33);
    // Long hair falls behind the shoulders.
    let long = if stream.chance(0.4) { stream.range(0.12, 0.24) } else { 0.0 };
    if long > 0.0 {
        canvas.fill(hair, seed + 4, |at| {
            rounded(at, [middle, head_y + 0.5 * long - 0.02], [0.095, 0.5 * long + 0.06], 0.07)
        });
    }
    // Torso and arms.
    canvas.fill(cloth, seed, |at| {
        let torso = rounded(at, [middle, shoulder_y + 0.45], [width, 0.5], 0.09);
        let neck = limb(at, [middle, head_y + 0.05], [middle, shoulder_y], [0.05, 0.07]);
        torso.min(neck)
    });
    let elbow_y = shoulder_y + stream.range(0.18, 0.26);
    let hand_y = head_y + stream.range(0.0, 0.05);
    let is_telephone = stream.chance(0.6);
    for side in [-1.0f32, 1.0] {
        let shoulder = [middle + side * (width - 0.03), shoulder_y + 0.02];
        let elbow = [middle + side * reach, elbow_y + stream.range(-0.03, 0.03)];
        let hand = [middle + side * if is_telephone { 0.05 } else { 0.08 }, hand_y];
        canvas.fill(cloth, seed + 1, |at| {
            limb(at, shoulder, elbow, [0.055, 0.045]).min(limb(at, elbow, hand, [0.045, 0.03]))
        });
        canvas.fill(skin, seed + 2, |at| ellipse(at, hand, [0.032, 0.038]));
    }
    // Head, hair and what it holds before the face.
    canvas.fill(skin, seed + 3, |at| ellipse(at, [middle, head_y], [0.07, 0.095]));
    canvas.fill(hair, seed + 4, |at| {
        let cap = ellipse(at, [middle, head_y - 0.035], [0.082, 0.085]);
        let face = ellipse(at, [middle, head_y + 0.03], [0.062, 0.085]);
        cap.max(-face)
    });
    let case = tint(stream, 0.08, 0.06);
    if is_telephone {
        canvas.fill(case, seed + 5, |at| rounded(at, [middle, hand_y], [0.036, 0.072], 0.01));
        canvas.fill([0.3; 3], seed, |at| ellipse(at, [middle - 0.018, hand_y - 0.05], [0.008; 2]));
    } else {
        canvas.fill(case, seed + 5, |at| rounded(at, [middle, hand_y], [0.075, 0.045], 0.012));
        canvas.fill([0.22; 3], seed, |at| ellipse(at, [middle, hand_y], [0.036; 2]));
        canvas.fill([0.05, 0.06, 0.1], seed, |at| ellipse(at, [middle, hand_y], [0.026; 2]));
    }
}

fn blind(canvas: &mut Canvas, stream: &mut Stream) {
    let slats = stream.range(14.0, 36.0) as i32;
    let (pitch, share) = (1.0 / slats as f32, stream.range(0.3, 0.85));
    let grey = stream.range(0.5, 0.95);
    let (colour, seed) = (tint(stream, grey, 0.12), stream.seed());
    // A blind that is not drawn to the end leaves the lower part free.
    let end = if stream.chance(0.5) { 1.1 } else { stream.range(0.35, 0.9) };
    canvas.paint(|at| {
        let slat = (at[1] / pitch) as i32;
        let droop = 0.1 * pitch * (noise2(at[0] * 3.0, slat as f32 * 9.7, seed) - 0.5);
        let within = at[1] + droop - (slat as f32 + 0.5) * pitch;
        let half = 0.5 * share * pitch;
        // The upper edge of a slat is bent towards the light.
        let shade = 0.75 + 0.25 * (0.5 - within / (2.0 * half)).clamp(0.0, 1.0);
        ((within.abs() - half).max(at[1] - end), colour.map(|v| v * shade), 1.0)
    });
    for k in 0..3 {
        let x = CoverKind::Blind.aspect() * (0.18 + 0.32 * k as f32) + stream.range(-0.02, 0.02);
        canvas.paint(|at| (((at[0] - x).abs() - 0.002).max(at[1] - end), [0.8; 3], 1.0));
    }
    canvas.fill(colour, seed, |at| (at[1] - end).abs() - 0.4 * pitch);
}

fn curtain(canvas: &mut Canvas, stream: &mut Stream) {
    let (grey, folds) = (stream.range(0.3, 0.9), stream.range(6.0, 16.0));
    let (colour, seed) = (tint(stream, grey, 0.3), stream.seed());
    let sheer = if stream.chance(0.4) { stream.range(0.45, 0.75) } else { 1.0 };
    let width = CoverKind::Curtain.aspect() * stream.range(0.55, 0.9);
    let from_left = stream.chance(0.5);
    canvas.paint(|at| {
        let x = if from_left { at[0] } else { CoverKind::Curtain.aspect() - at[0] };
        let wave = 0.05 * (noise2(at[1] * 2.5, 3.0, seed) - 0.5) + 0.05 * at[1];
        let fold =
            noise2(x * folds + 0.6 * noise2(at[1] * 2.0, x * 4.0, seed + 1), at[1] * 0.4, seed);
        // Cloth is denser where it turns away.
        let opacity = sheer + (1.0 - sheer) * 0.6 * (1.0 - fold);
        (x - width - wave, colour.map(|v| v * (0.55 + 0.45 * fold)), opacity)
    });
}

fn plant(canvas: &mut Canvas, stream: &mut Stream) {
    let middle = 0.5 * CoverKind::Plant.aspect();
    let grey = stream.range(0.2, 0.8);
    let (pot, seed) = (tint(stream, grey, 0.3), stream.seed());
    let top = stream.range(0.78, 0.88);
    for stem in 0..6 + stream.index(7) {
        let lean = stream.range(-0.3, 0.3);
        let tip = [middle + lean, stream.range(0.06, 0.5)];
        let green = [stream.range(0.1, 0.3), stream.range(0.3, 0.55), stream.range(0.08, 0.25)];
        let foot = [middle + 0.2 * lean, top + 0.03];
        canvas.fill(green.map(|v| v * 0.7), seed, |at| limb(at, foot, tip, [0.006, 0.003]));
        let leaves = 4 + stream.index(6);
        for leaf in 0..leaves {
            let t = (leaf as f32 + 0.6) / leaves as f32;
            let node = [foot[0] + t * (tip[0] - foot[0]), foot[1] + t * (tip[1] - foot[1])];
            let side = if (leaf + stem) % 2 == 0 { 1.0 } else { -1.0 };
            let (long, rise) = (stream.range(0.05, 0.13), stream.range(-0.06, 0.03));
            let end = [node[0] + side * long, node[1] + rise];
            let thick = stream.range(0.012, 0.028);
            let shade = stream.range(0.7, 1.2);
            canvas.fill(green.map(|v| v * shade), seed + 1, |at| {
                // Two limbs that taper to both ends of the leaf.
                let mid = [0.5 * (node[0] + end[0]), 0.5 * (node[1] + end[1])];
                let inner = limb(at, node, mid, [0.002, thick]);
                inner.min(limb(at, mid, end, [thick, 0.001]))
            });
        }
    }
    canvas.fill(pot, seed + 2, |at| {
        let taper = 0.12 - 0.25 * (at[1] - top).max(0.0);
        ((at[0] - middle).abs() - taper).max(top - at[1])
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First 16 digits of the BLAKE3 digest of a picture of each kind.
    const DIGESTS: [&str; 4] =
        ["ff9af122e2944a98", "d4f173509863846b", "0b0cb2d2e87893f9", "59b0844ebb70c5cc"];

    #[test]
    fn pictures_are_pinned() {
        let of = |kind| {
            let digest = blake3::hash(&cover(kind, 7, 96).rgba);
            digest.to_hex()[..16].to_owned()
        };
        let found = CoverKind::ALL.map(of);
        assert_eq!(found, DIGESTS, "new digests: {found:#?}");
    }

    /// Every picture has opaque and transparent parts, with soft edges between them, and differs with its seed.
    #[test]
    fn pictures_cover_a_part() {
        for kind in CoverKind::ALL {
            for seed in 0..20 {
                let picture = cover(kind, seed, 128);
                assert_eq!(picture.rgba.len() as u32, 4 * picture.width * picture.height);
                let alphas = || picture.rgba.chunks(4).map(|pixel| pixel[3]);
                let pixels = f64::from(picture.width * picture.height);
                let covered = alphas().map(f64::from).sum::<f64>() / 255.0 / pixels;
                assert!((0.08..0.95).contains(&covered), "{kind:?} {seed}: {covered}");
                assert!(alphas().any(|a| a == 0) && alphas().any(|a| (1..255).contains(&a)));
                assert_ne!(picture, cover(kind, seed + 1, 128));
            }
        }
    }

    #[test]
    fn a_png_has_the_pixels() {
        let picture = cover(CoverKind::Plant, 3, 64);
        let png = cover_png(CoverKind::Plant, 3, 64).unwrap();
        let read = image::load_from_memory(&png).unwrap().into_rgba8();
        assert_eq!((read.width(), read.height()), (picture.width, picture.height));
        assert_eq!(read.into_raw(), picture.rgba);
    }
}
