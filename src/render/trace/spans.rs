//! Finds the spans of bundles: of squares of the film, so that one search serves several patches, or of single pixels.

use super::bundle::Bundle;
use super::lanes::{CHUNK, LANES};
use super::lines::{ViewLanes, span_of_area};
use super::patch::{Area, PATCH_PX};
use super::scene::{Scene, View};
use super::walk::{GridLanes, Group, LaneSpans, Span};

/// Side of a square that shares a span, px, a multiple of the side of a patch. Squares begin at multiples of this length,
/// wherever a tile begins.
const SQUARE_PX: u32 = 8;

/// Product of a pixel's samples and the travel of its square's lines beyond the first cell, px, above which the pixel's own
/// span, which is shorter, costs less than it saves.
const CELLS_OF_PIXEL: f32 = 400.0;

/// Spans of a bundle.
pub(super) enum Found<'a> {
    /// Of all rays.
    Shared(LaneSpans),
    /// Of all rays, which spread so far that each has a shorter span of its own.
    Spread(Span),
    /// Of the rays of each pixel.
    OfPixels(&'a [OfPixel; LANES]),
}

/// Span of the rays of one pixel, and the grid point to which they are relative, in all lanes.
pub(super) struct OfPixel {
    lanes: GridLanes,
    spans: LaneSpans,
}

impl OfPixel {
    pub(super) fn group(&self) -> Group<'_> {
        Group { lanes: &self.lanes, spans: &self.spans }
    }
}

/// Newest spans of a group of orders.
struct OfGroup {
    /// For each column of squares, the row of the newest square, its span and the travel of its lines, px.
    squares: Vec<Option<(u32, Span, f32)>>,
    /// The newest patch whose pixels have their own spans, by its corner.
    pixels: Option<([u32; 2], Box<[OfPixel; LANES]>)>,
}

/// Spans of the groups of orders of a scene. The choice of a span depends only on scene, patch and range of samples, so pixels do not depend
/// on tiles, even if a hit at the end of a span were to.
pub(super) struct Spans(Vec<OfGroup>);

impl Spans {
    /// Makes room for the spans of all groups.
    pub(super) fn new(scene: &Scene) -> Self {
        let columns = scene.film.width.div_ceil(SQUARE_PX) as usize;
        let smeared = scene.smeared.as_ref().map(|smeared| &smeared.orders);
        let plans = std::iter::once(&scene.orders).chain(smeared);
        // Each order may be a group; T and R are two more.
        let groups = 2 + plans.map(|plan| plan.front.len() + plan.back.len()).sum::<usize>();
        let group = |_| OfGroup { squares: vec![None; columns], pixels: None };
        Self((0..groups).map(group).collect())
    }

    /// Returns the spans of a bundle in a view with an aligned pose.
    #[inline(always)]
    pub(super) fn of(
        &mut self,
        scene: &Scene,
        view: &View,
        lanes: &ViewLanes,
        bundle: &Bundle,
        extra_m: f64,
    ) -> Found<'_> {
        let (number, paths) = bundle.group;
        let of_group = &mut self.0[number];
        let corner = bundle.patch.corner;
        let may_pass_beside = bundle.is_t_0() && scene.cover.outline.is_some();
        let find = |x: u32, y: u32, side_px: u32| {
            let area = Area::new(scene, x, y, side_px);
            span_of_area(scene, view, paths, &area, extra_m, may_pass_beside)
        };
        let [column, row] = corner.map(|v| v / SQUARE_PX);
        let square = &mut of_group.squares[column as usize];
        let (span, travel_px) = match square {
            Some((of_row, span, travel_px)) if *of_row == row => (*span, *travel_px),
            _ => {
                let (span, travel_px) = find(column * SQUARE_PX, row * SQUARE_PX, SQUARE_PX);
                *square = Some((row, span, travel_px));
                (span, travel_px)
            }
        };
        // Fewer samples than a chunk's would leave lanes of a pixel's group idle.
        let is_short = (travel_px - 1.0) * bundle.samples as f32 <= CELLS_OF_PIXEL;
        if is_short || bundle.ends[2] < CHUNK {
            return Found::Shared(span.into());
        }
        if of_group.pixels.as_ref().is_none_or(|(of_corner, _)| *of_corner != corner) {
            let pixels = std::array::from_fn(|l| {
                let (x, y) = (l as u32 % PATCH_PX, l as u32 / PATCH_PX);
                let (span, _) = find(corner[0] + x, corner[1] + y, 1);
                let base = [0, 1].map(|k| [lanes.grid.base[k][l]; LANES]);
                OfPixel { lanes: GridLanes::new(&view.grid, base), spans: span.into() }
            });
            of_group.pixels = Some((corner, Box::new(pixels)));
        }
        let (_, pixels) = of_group.pixels.as_ref().expect("set above");
        Found::OfPixels(pixels)
    }
}
