//! Textures of surfaces: factors of light with details down to single pixels, which smooth pictures lack.

use super::layers::multiply_planes;
use crate::random::Stream;
use std::sync::LazyLock;

/// Number of kinds of surface in a picture, each with its texture.
const KINDS: usize = 6;
/// Range of the number of cells into which the share of a channel in a colour is divided.
const SHARE_CELLS: [f64; 2] = [8.0, 14.0];
/// Range of the number of cells per doubling of light.
const LIGHT_CELLS: [f64; 2] = [0.4, 0.9];
/// Least light that is told apart from black.
const DARK: f32 = 1e-4;
/// Ranges of the spacings of a texture's finest and coarsest octave, px; log-uniform.
const FINEST_PX: [f64; 2] = [1.0, 3.3];
const COARSEST_PX: [f64; 2] = [4.0, 32.0];
/// Range of the exponent of an octave's weight by its spacing.
const SLOPE: [f64; 2] = [-0.7, 0.8];
/// Share of textures that are longer than wide, and standard deviation of the logarithm of their stretch.
const STRETCHED: f64 = 0.4;
const STRETCH_SIGMA: f64 = 0.7;
/// Share of textures with few and strong spots.
const SPOTTED: f64 = 0.4;
/// Largest deviation of a texture from its mean, in standard deviations.
const MOST_SIGMAS: f32 = 3.0;

/// The textures of an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnTexture {
    pub seed: u64,
    /// Range of the standard deviation of the logarithm of a texture's factors.
    pub sigma: [f64; 2],
}

impl DrawnTexture {
    /// Multiplies square planes, and others of the same surfaces, by the textures that the colours of the first ones have.
    /// `name` tells the pictures of an example apart.
    pub(super) fn multiply(
        &self,
        name: &str,
        planes: &mut [f32],
        others: Option<&mut Vec<f32>>,
        side_px: usize,
    ) {
        let mut stream = Stream::new(self.seed, name);
        let surfaces = Surfaces::draw(&mut stream);
        let kinds = [(); KINDS].map(|()| Kind::draw(self.sigma, &mut stream));
        let pixels = side_px * side_px;
        let factor = |at: usize| {
            let colour = [0, 1, 2].map(|channel| planes[channel * pixels + at]);
            kinds[surfaces.kind(colour)].factor((at % side_px) as f32, (at / side_px) as f32)
        };
        let factors: Vec<f32> = (0..pixels).map(factor).collect();
        for planes in [Some(planes), others.map(Vec::as_mut_slice)].into_iter().flatten() {
            multiply_planes(planes, &factors);
        }
    }
}

/// Cells of colour and light: pixels of one cell are of one kind of surface.
struct Surfaces {
    /// Number of cells, and their offset, of the shares of red and blue and of doublings of light.
    cells: [[f32; 2]; 3],
}

impl Surfaces {
    fn draw(stream: &mut Stream) -> Self {
        let mut cells = |range| [stream.uniform(range) as f32, stream.unit() as f32];
        Self { cells: [cells(SHARE_CELLS), cells(SHARE_CELLS), cells(LIGHT_CELLS)] }
    }

    /// Returns the kind of a linear colour without negative channels, 0 to `KINDS - 1`.
    fn kind(&self, [red, green, blue]: [f32; 3]) -> usize {
        let light = red + green + blue + DARK;
        let places = [red / light, blue / light, doublings(light)];
        let cell = |axis: usize| {
            let [count, offset] = self.cells[axis];
            (places[axis] * count + offset) as i32 as usize
        };
        (31 * cell(0) + 7 * cell(1) + cell(2)) % KINDS
    }
}

/// Returns the binary logarithm of a positive number, plus 127: exact at powers of two and linear between them.
fn doublings(value: f32) -> f32 {
    value.to_bits() as f32 / (1 << (f32::MANTISSA_DIGITS - 1)) as f32
}

/// The texture of a kind of surface: octaves of noise, turned and stretched.
struct Kind {
    sigma: f32,
    /// Rows of the matrix from pixels to the noise's plane.
    turn: [[f32; 2]; 2],
    octaves: Vec<Octave>,
    is_spotted: bool,
}

struct Octave {
    tile: &'static Tile,
    /// Samples of the tile in a pixel, about 1.
    per_px: f32,
    /// Factor of the samples; those of all octaves bring the sum's standard deviation to 1.
    weight: f32,
    /// Place of the origin in the tile, in samples.
    origin: [f32; 2],
}

impl Kind {
    fn draw(sigma: [f64; 2], stream: &mut Stream) -> Self {
        let sigma = stream.log_uniform(sigma) as f32;
        let angle = stream.uniform([0.0, std::f64::consts::PI]);
        let is_stretched = stream.unit() < STRETCHED;
        let stretch = libm::exp((STRETCH_SIGMA * stream.normal()).abs());
        let stretch = if is_stretched { stretch } else { 1.0 };
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        let turn = [[cosine * stretch, sine * stretch], [-sine / stretch, cosine / stretch]];
        let [finest_px, coarsest_px] = [FINEST_PX, COARSEST_PX].map(|px| stream.log_uniform(px));
        let slope = stream.uniform(SLOPE);
        let spacings: Vec<f64> = std::iter::successors(Some(finest_px), |px| Some(2.0 * px))
            .take_while(|px| *px <= coarsest_px)
            .collect();
        let weight = |px: f64| libm::pow(px, slope);
        let norm = spacings.iter().map(|px| weight(*px).powi(2)).sum::<f64>().sqrt();
        let octave = |(level, px): (usize, &f64)| Octave {
            tile: &TILES[level],
            per_px: ((1 << level) as f64 / px) as f32,
            weight: (weight(*px) / norm / STEPS) as f32,
            origin: [(); 2].map(|()| (stream.unit() * SIDE as f64) as f32),
        };
        let octaves = spacings.iter().enumerate().map(octave).collect();
        let turn = turn.map(|row| row.map(|value| value as f32));
        Self { sigma, turn, octaves, is_spotted: stream.unit() < SPOTTED }
    }

    /// Returns the factor of light at a pixel; the mean over a surface is about 1.
    fn factor(&self, x: f32, y: f32) -> f32 {
        let [u, v] = self.turn.map(|[across, down]| across * x + down * y);
        let noise = |octave: &Octave| {
            let [left, top] = octave.origin;
            octave.weight * octave.tile.at(u * octave.per_px + left, v * octave.per_px + top)
        };
        let sum = self.octaves.iter().map(noise).sum::<f32>();
        // The square of a normal number has a second moment of 3.
        let sum = if self.is_spotted { sum * sum.abs() / 3f32.sqrt() } else { sum };
        let sum = sum.clamp(-MOST_SIGMAS, MOST_SIGMAS);
        libm::expf(self.sigma * sum - 0.5 * self.sigma * self.sigma)
    }
}

/// Number of octaves, and samples along the side of a tile: powers of two.
const LEVELS: usize = 6;
const SIDE: usize = 256;

/// Square tiles of value noise with normal nodes, a mean of 0 and a standard deviation of 1. Tile k has 2^k samples from one
/// node to the next.
static TILES: LazyLock<[Tile; LEVELS]> = LazyLock::new(|| std::array::from_fn(Tile::new));

/// Makes the tiles that are otherwise made at their first use.
pub(crate) fn prepare() {
    LazyLock::force(&TILES);
}

struct Tile(Vec<i8>);

/// Steps of a sample in a standard deviation. Small samples keep all tiles in a processor's cache.
const STEPS: f64 = 32.0;

impl Tile {
    fn new(level: usize) -> Self {
        let (samples, nodes) = (1 << level, SIDE >> level);
        let mut stream = Stream::new(level as u64, "texture");
        let values: Vec<f64> = (0..nodes * nodes).map(|_| stream.normal()).collect();
        let value = |row: usize, column: usize| values[row % nodes * nodes + column % nodes];
        // Smooth weights of two neighbours.
        let weights: Vec<[f64; 2]> = (0..samples)
            .map(|k| k as f64 / samples as f64)
            .map(|t| t * t * (3.0 - 2.0 * t))
            .map(|t| [1.0 - t, t])
            .collect();
        let square = |pair: &[f64; 2]| pair.iter().map(|weight| weight * weight).sum::<f64>();
        // The variance along each axis.
        let norm = weights.iter().map(square).sum::<f64>() / samples as f64;
        let sample = |at: usize| {
            let [row, column] = [at / SIDE, at % SIDE];
            let (down, across) = (weights[row % samples], weights[column % samples]);
            let along = |row: usize| {
                let column = column / samples;
                across[0] * value(row, column) + across[1] * value(row, column + 1)
            };
            let row = row / samples;
            let value = (down[0] * along(row) + down[1] * along(row + 1)) / norm;
            libm::round(value * STEPS) as i8
        };
        Self((0..SIDE * SIDE).map(sample).collect())
    }

    /// Returns a sample near a place, in samples; the tile repeats.
    fn at(&self, u: f32, v: f32) -> f32 {
        let [column, row] = [u, v].map(|place| place as i32 as usize % SIDE);
        f32::from(self.0[row * SIDE + column])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE_PX: usize = 128;

    #[test]
    fn factors_have_the_drawn_deviation_and_a_mean_of_one() {
        for seed in 0..40 {
            let kind = Kind::draw([0.1; 2], &mut Stream::new(seed, "texture"));
            let at = |k: usize| kind.factor((k % SIDE_PX) as f32, (k / SIDE_PX) as f32);
            let logs: Vec<f64> = (0..SIDE_PX * SIDE_PX).map(|k| f64::from(at(k)).ln()).collect();
            let mean = logs.iter().sum::<f64>() / logs.len() as f64;
            let square = logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>();
            let sigma = (square / logs.len() as f64).sqrt();
            assert!((0.06..0.12).contains(&sigma), "{seed}: {sigma}");
            assert!((mean + 0.005).abs() < 0.03, "{seed}: {mean}");
        }
    }

    #[test]
    fn surfaces_are_told_apart_by_their_colour() {
        let surfaces = Surfaces::draw(&mut Stream::new(4, "front"));
        let kinds = [[0.5, 0.5, 0.5], [0.5, 0.3, 0.1], [0.1, 0.3, 0.5], [0.02, 0.02, 0.02]];
        let mut found = kinds.map(|colour| surfaces.kind(colour)).to_vec();
        assert_eq!(surfaces.kind([0.501, 0.5, 0.5]), found[0]);
        assert!(surfaces.kind([0.0; 3]) < KINDS);
        found.sort_unstable();
        found.dedup();
        assert!(found.len() >= 3, "{found:?}");
    }

    /// Layers of the same surfaces get the same factors, and so do the three channels of a pixel.
    #[test]
    fn layers_of_the_same_surfaces_have_the_same_texture() {
        let texture = DrawnTexture { seed: 6, sigma: [0.2; 2] };
        let pixels = SIDE_PX * SIDE_PX;
        let mut planes = vec![0.4; 3 * pixels];
        let mut dimmed: Vec<f32> = planes.iter().map(|value| value * 0.5).collect();
        texture.multiply("front", &mut planes, Some(&mut dimmed), SIDE_PX);
        assert!(planes.iter().zip(&dimmed).all(|(a, b)| *a == 2.0 * b));
        assert!(planes[..pixels] == planes[pixels..2 * pixels]);
        let mut other = vec![0.4; 3 * pixels];
        texture.multiply("reflection", &mut other, None, SIDE_PX);
        assert!(other != planes);
        // Black stays black.
        let mut black = vec![0.0; 3 * pixels];
        texture.multiply("front", &mut black, None, SIDE_PX);
        assert!(black.iter().all(|value| *value == 0.0));
    }
}
