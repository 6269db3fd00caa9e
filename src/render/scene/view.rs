//! Finds intrinsics that cannot be those of a photograph's camera, such as those of another image or in another unit.

use super::error::AssembleError;
use super::geometry::{largest_roughness, unfiltered_film};
use super::place::Placed;
use glasshouse_line::{Apex, Intrinsics, SceneLine, Side};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Least and largest field of view of a photograph's camera, degrees.
const VIEW_DEG: [f64; 2] = [0.5, 170.0];
/// Least and largest ratio of the focal lengths across and down: pixels are nearly square.
const FOCAL_RATIO: [f64; 2] = [0.8, 1.25];
/// Share of the film's rays beside the photograph above which its intrinsics are remarked.
pub(crate) const MISSED_SHARE: f64 = 0.5;
/// Parts of a width or height within which the principal point of an image that was not cropped is.
const MIDDLE: [f64; 2] = [0.25, 0.75];

/// A photograph's intrinsics that are probably wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OddView {
    /// The intrinsics, with the size of the image to which they refer.
    pub intrinsics: Intrinsics,
    /// True if the line states the size.
    pub is_size_stated: bool,
    /// Width and height of the colour image, px.
    pub color_px: [usize; 2],
    /// Share of the film's rays that pass the photograph, for a lens and a pane that turn none.
    pub missed_share: f64,
}

impl OddView {
    /// Checks a photograph of a line by the sizes of its images, px. An error if no ray of the film can meet it.
    pub fn find(
        line: &SceneLine,
        side: &'static str,
        color_px: [usize; 2],
        depth_px: [usize; 2],
    ) -> Result<Option<Self>, AssembleError> {
        let of = if side == "front" { &line.front } else { &line.back };
        let Side::Photograph(photograph) = of else { return Ok(None) };
        let size = photograph.intrinsics.size.unwrap_or(depth_px.map(|side| side as u32));
        let intrinsics = Intrinsics { size: Some(size), ..photograph.intrinsics };
        let tangents = unfiltered_film(line).tan_half_fov;
        let missed_share = missed_share(&intrinsics, tangents, side == "back");
        let is_size_stated = photograph.intrinsics.size.is_some();
        let view = Self { intrinsics, is_size_stated, color_px, missed_share };
        let is_direct = largest_roughness(line).is_none() && of.apex() != Some(Apex::Camera);
        if missed_share >= 1.0 && is_direct {
            return Err(AssembleError::Missed { side, view: Box::new(view) });
        }
        Ok((!view.problems().is_empty()).then_some(view))
    }

    pub(super) fn of(
        line: &SceneLine,
        side: &'static str,
        placed: &Placed,
    ) -> Result<Option<Self>, AssembleError> {
        match placed {
            Placed::Sheet(sheet) => Self::find(
                line,
                side,
                [sheet.texture.width(), sheet.texture.height()],
                [sheet.width, sheet.height],
            ),
            Placed::Mesh(_) => Ok(None),
        }
    }

    /// Width and height of the image to which the intrinsics refer, px.
    fn size_px(&self) -> [f64; 2] {
        self.intrinsics.size.unwrap_or([1; 2]).map(f64::from)
    }

    /// Returns the fields of view across and down, degrees, of a camera whose axis is in the middle.
    fn view_deg(&self, size_px: [f64; 2]) -> [f64; 2] {
        let k = &self.intrinsics;
        [(size_px[0], k.fx), (size_px[1], k.fy)]
            .map(|(side, focal)| 2.0 * libm::atan(0.5 * side / focal).to_degrees())
    }

    /// Returns fx / fy, in pixels of the image, and in those of the colour image of the same view.
    fn focal_ratios(&self) -> [f64; 2] {
        let (k, [width, height]) = (&self.intrinsics, self.size_px());
        let [color_w, color_h] = self.color_px.map(|side| side as f64);
        let ratio = k.fx / k.fy;
        [ratio, ratio * (color_w / width) / (color_h / height)]
    }

    /// Lists what is odd about the numbers.
    fn problems(&self) -> Vec<String> {
        let (k, size_px) = (&self.intrinsics, self.size_px());
        let [width, height] = size_px;
        let mut problems = Vec::new();
        let is_inside = |at: f64, side: f64| (0.0..=side).contains(&at);
        if !is_inside(k.cx, width) || !is_inside(k.cy, height) {
            problems.push(format!("the principal point ({}, {}) lies outside of it", k.cx, k.cy));
        }
        let views = self.view_deg(size_px);
        if views.iter().any(|view| !(VIEW_DEG[0]..=VIEW_DEG[1]).contains(view)) {
            let [across, down] = views;
            problems.push(format!("it has a field of view of {across:.3} x {down:.3} degrees"));
        }
        // A depth image that is narrower than its photograph has other pixels than square ones.
        let [ratio, of_color] = self.focal_ratios();
        let is_stretched = |ratio| !(FOCAL_RATIO[0]..=FOCAL_RATIO[1]).contains(&ratio);
        if is_stretched(of_color) && (self.is_size_stated || is_stretched(ratio)) {
            problems.push(format!(
                "in pixels of the colour image, fx / fy is {of_color:.3}, which only an image with stretched pixels has"
            ));
        }
        if self.missed_share > MISSED_SHARE {
            let percent = 100.0 * self.missed_share;
            problems.push(format!("{percent:.0} % of the film's rays pass the photograph"));
        }
        problems
    }

    /// True if the numbers are possible ones of the colour image, and not of its size.
    fn fits_color(&self) -> bool {
        let color_px = self.color_px.map(|side| side as f64);
        let k = &self.intrinsics;
        let is_central = |at: f64, side: f64| (MIDDLE[0]..=MIDDLE[1]).contains(&(at / side));
        let views = self.view_deg(color_px);
        color_px != self.size_px()
            && is_central(k.cx, color_px[0])
            && is_central(k.cy, color_px[1])
            && views.iter().all(|view| (VIEW_DEG[0]..=VIEW_DEG[1]).contains(view))
            && !(FOCAL_RATIO[1] * k.fy < k.fx || k.fx < FOCAL_RATIO[0] * k.fy)
    }

    /// Formats the remark on a photograph.
    pub fn text(&self, what: &str) -> String {
        let [width, height] = self.size_px();
        let problems = self.problems().join(", and ");
        let mut text = format!(
            "{what}: its intrinsics are taken in pixels of an image of {width}x{height}: {problems}; "
        );
        let [w, h] = self.color_px;
        let _ = if self.fits_color() {
            write!(text, "they fit the colour image, so give intrinsics \"size\": [{w}, {h}]")
        } else {
            write!(
                text,
                "check that intrinsics are in pixels, in the order fx, fy, cx, cy, and of the image that \"size\" states (the \
                 colour image has {w}x{h})"
            )
        };
        if self.problems().len() == 1 && self.missed_share > MISSED_SHARE {
            text.push_str("; if they are right, take a longer camera.focal_length_mm");
        }
        text
    }
}

/// Returns the share of the film's rays through the lens's centre that pass a photograph whose camera is there, too.
fn missed_share(k: &Intrinsics, tan_half_fov: [f64; 2], is_mirrored: bool) -> f64 {
    let [width, height] = k.size.unwrap_or([1; 2]).map(f64::from);
    let met = |focal: f64, center: f64, side: f64, most: f64, sign: f64| {
        let [a, b] = [-center / focal, (side - center) / focal].map(|tangent| sign * tangent);
        let (from, to) = (a.min(b).max(-most), a.max(b).min(most));
        ((to - from) / (2.0 * most)).max(0.0)
    };
    let sign = if is_mirrored { -1.0 } else { 1.0 };
    let across = met(k.fx, k.cx, width, tan_half_fov[0], sign);
    1.0 - across * met(k.fy, k.cy, height, tan_half_fov[1], 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::parse_scene;

    /// Checks a front of these numbers and sizes, seen with 55 mm.
    fn find(
        numbers: &str,
        color_px: [usize; 2],
        depth_px: [usize; 2],
    ) -> Result<Option<OddView>, AssembleError> {
        let side =
            |numbers: &str| format!(r#"{{"color":"c","depth":"d","intrinsics":{{{numbers}}}}}"#);
        let line = format!(
            r#"{{"schema":"glasshouse.scene/1","id":"a","seed":1,"film":{{"width":32,"height":24,"spp":4}},
                "camera":{{"focal_length_mm":55,"aperture_radius_m":0.01,"focus":{{"distance_m":2}}}},
                "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.5}},"front":{},"back":{}}}"#,
            side(numbers),
            side(r#""fx":9,"fy":9,"cx":4,"cy":4"#),
        );
        OddView::find(&parse_scene(&line).unwrap(), "front", color_px, depth_px)
    }

    fn text(numbers: &str, color_px: [usize; 2], depth_px: [usize; 2]) -> String {
        match find(numbers, color_px, depth_px) {
            Ok(view) => view.map_or_else(String::new, |view| view.text("front photograph")),
            Err(error) => format!("refused: {error}"),
        }
    }

    #[test]
    fn numbers_of_this_photograph_are_not_odd() {
        for (numbers, color_px, depth_px) in [
            (r#""fx":710,"fy":710,"cx":360,"cy":480,"size":[720,960]"#, [720, 960], [192, 256]),
            (r#""fx":886.81,"fy":927.06,"cx":512,"cy":384"#, [1024, 768], [1024, 768]),
            // A square depth image of a wide photograph, a principal point on the edge, and images of few pixels.
            (r#""fx":210,"fy":280,"cx":128,"cy":128"#, [640, 480], [256, 256]),
            (r#""fx":100,"fy":100,"cx":100,"cy":0"#, [400, 400], [400, 400]),
            (r#""fx":2,"fy":2,"cx":1,"cy":1"#, [2, 2], [2, 2]),
        ] {
            assert_eq!(text(numbers, color_px, depth_px), "", "{numbers}");
        }
    }

    #[test]
    fn odd_numbers_are_remarked_with_a_remedy() {
        let square = [96, 96];
        for (numbers, color_px, depth_px, words) in [
            // Those of the colour image, which has twice the size, and three times.
            (
                r#""fx":710,"fy":710,"cx":360,"cy":480"#,
                [720, 960],
                [360, 480],
                ["75 % of the film's rays pass", "\"size\": [720, 960]"],
            ),
            (
                r#""fx":300,"fy":300,"cx":150,"cy":200"#,
                [300, 400],
                [100, 133],
                ["principal point (150, 200) lies outside", "\"size\": [300, 400]"],
            ),
            // Parts of the width, millimetres, and other orders.
            (
                r#""fx":0.866,"fy":0.866,"cx":0.5,"cy":0.5"#,
                square,
                square,
                ["view of 177.9", "are in pixels"],
            ),
            (
                r#""fx":4.2,"fy":4.2,"cx":320,"cy":240"#,
                [640, 480],
                [640, 480],
                ["view of 178.496 x 177.995", "are in pixels"],
            ),
            (
                r#""fx":0.001,"fy":0.001,"cx":48,"cy":48"#,
                square,
                square,
                ["view of 179.9", "are in pixels"],
            ),
            (
                r#""fx":100000,"fy":100000,"cx":48,"cy":48"#,
                square,
                square,
                ["view of 0.055 x", "100 % of the film's rays"],
            ),
            (
                r#""fx":90,"fy":48,"cx":48,"cy":48"#,
                square,
                square,
                ["fx / fy is 1.875", "order fx, fy, cx, cy"],
            ),
            // A size whose sides are exchanged.
            (
                r#""fx":710,"fy":710,"cx":360,"cy":480,"size":[960,720]"#,
                [720, 960],
                [192, 256],
                [
                    "an image of 960x720: in pixels of the colour image, fx / fy is 0.56",
                    "\"size\": [720, 960]",
                ],
            ),
        ] {
            let text = text(numbers, color_px, depth_px);
            assert!(text.starts_with("front photograph: its intrinsics"), "{numbers}: {text}");
            assert!(words.iter().all(|words| text.contains(words)), "{numbers}: {text}");
        }
    }

    #[test]
    fn a_photograph_that_no_ray_meets_is_refused() {
        for numbers in [
            r#""fx":710,"fy":710,"cx":360,"cy":480"#,
            r#""fx":160,"fy":160,"cx":10000,"cy":10000"#,
            r#""fx":160,"fy":160,"cx":-60,"cy":48"#,
        ] {
            let text = text(numbers, [720, 960], [192, 256]);
            assert!(
                text.starts_with("refused: front photograph: no ray of the film meets it"),
                "{text}"
            );
            assert!(text.contains("intrinsics") && text.contains("principal point"), "{text}");
        }
    }

    #[test]
    fn rays_beside_the_photograph_are_counted() {
        let of = |cx: f64, is_mirrored| {
            let k = Intrinsics { fx: 100.0, fy: 100.0, cx, cy: 50.0, size: Some([100, 100]) };
            missed_share(&k, [0.5, 0.25], is_mirrored)
        };
        assert_eq!((of(50.0, false), of(25.0, false), of(25.0, true)), (0.0, 0.25, 0.25));
        assert_eq!((of(150.0, false), of(-50.0, true)), (1.0, 1.0));
        let narrow =
            Intrinsics { fx: 200.0, fy: 200.0, cx: 50.0, cy: 50.0, size: Some([100, 100]) };
        assert_eq!(missed_share(&narrow, [0.5, 0.5], false), 0.75);
    }
}
