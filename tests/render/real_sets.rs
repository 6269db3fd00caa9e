//! Files and scene lines of the public data sets, and readers that do not use the program's own decoders.

use render::atomic_file;
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Name of the file of `motorcycle`'s depth in metres, which [`write_motorcycle_depth`] writes.
pub(crate) const MOTORCYCLE_DEPTH: &str = "motorcycle_depth.npy";

/// A photograph of a data set.
pub(crate) struct Set {
    pub(crate) name: &'static str,
    /// Path below the root of the sets.
    pub(crate) color: &'static str,
    /// Path below the root of the sets, or [`MOTORCYCLE_DEPTH`].
    pub(crate) depth: &'static str,
    pub(crate) depth_unit_m: f64,
    /// fx, fy, cx and cy in px; the image's corner is (0, 0).
    pub(crate) intrinsics: [f64; 4],
}

/// Photographs of seven sets. Intrinsics are those of the sources plus 0.5 px in cx and cy, because the sources put
/// pixel centres at integers.
///
/// No set has `fill` "far": the holes are between measured pixels (in `road`, between the rows of a lidar), so the
/// farthest depth would lie behind the objects around a hole.
pub(crate) const SETS: [Set; 7] = [
    Set {
        name: "motorcycle",
        color: "middlebury_motorcycle/motorcycle_left.png",
        depth: MOTORCYCLE_DEPTH,
        depth_unit_m: 1.0,
        intrinsics: [994.978, 994.978, 311.693, 255.377],
    },
    Set {
        name: "basement",
        color: "nyu_basement/rgb_00000.jpg",
        depth: "nyu_basement/sync_depth_00000.png",
        depth_unit_m: 0.001,
        intrinsics: [518.8579, 519.46961, 326.08245, 254.23617],
    },
    Set {
        name: "kitchen",
        color: "sevenscenes_kitchen/frame-000000.color.jpg",
        depth: "sevenscenes_kitchen/frame-000000.depth.png",
        depth_unit_m: 0.001,
        intrinsics: [585.0, 585.0, 320.5, 240.5],
    },
    Set {
        name: "chair",
        color: "redwood_chair/color/00000.jpg",
        depth: "redwood_chair/depth/00000.png",
        depth_unit_m: 0.001,
        intrinsics: [525.0, 525.0, 320.0, 240.0],
    },
    Set {
        name: "office",
        color: "hololens_office/images/00050.png",
        depth: "hololens_office/depth/00050.png",
        depth_unit_m: 0.001,
        intrinsics: [495.5678, 495.4820, 270.0029, 169.6941],
    },
    Set {
        name: "road",
        color: "kitti_road/rgb/0000000050.png",
        depth: "kitti_road/depth/0000000050.png",
        depth_unit_m: 1.0 / 256.0,
        intrinsics: [707.0493, 707.0493, 604.5814, 181.0066],
    },
    // The source has no intrinsics. These are `basement`'s after resizing by 250/480 to 333 x 250, cropping to the
    // central 304 x 228, and resizing to 224 x 224.
    Set {
        name: "dining",
        color: "nyu_dining_npy/rgb.npy",
        depth: "nyu_dining_npy/depth.npy",
        depth_unit_m: 1.0,
        intrinsics: [199.1, 265.8, 114.5, 119.3],
    },
];

/// Returns the folder of the sets; prints a note if it does not exist.
pub(crate) fn find_sets() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/rgbd");
    if root.join("README.md").is_file() {
        return Some(root);
    }
    println!("skipped: no photographs at {}", root.display());
    None
}

impl Set {
    /// Makes `front` or `back` of a scene line.
    pub(crate) fn line(&self) -> Value {
        let [fx, fy, cx, cy] = self.intrinsics;
        let depth = match self.depth {
            MOTORCYCLE_DEPTH => MOTORCYCLE_DEPTH.to_owned(),
            path => format!("rgbd:{path}"),
        };
        json!({
            "color": format!("rgbd:{}", self.color), "depth": depth, "depth_unit_m": self.depth_unit_m,
            "intrinsics": { "fx": fx, "fy": fy, "cx": cx, "cy": cy },
        })
    }

    /// Returns the share of the depth image without a finite depth above 0.
    pub(crate) fn hole_share(&self, root: &Path, converted: &Path) -> f64 {
        let depths: Vec<f64> = match self.depth {
            MOTORCYCLE_DEPTH => read_npy::<f32>(&converted.join(MOTORCYCLE_DEPTH)).1,
            path if Path::new(path).extension().is_some_and(|e| e == "npy") => {
                read_npy::<f32>(&root.join(path)).1
            }
            path => image::open(root.join(path))
                .unwrap()
                .into_luma16()
                .iter()
                .map(|&code| f64::from(code))
                .collect(),
        };
        let holes = depths.iter().filter(|z| !(z.is_finite() && **z > 0.0)).count();
        holes as f64 / depths.len() as f64
    }
}

/// Returns the shape and the values of a C-ordered `.npy`.
fn read_npy<T: npyz::Deserialize + Into<f64>>(path: &Path) -> (Vec<u64>, Vec<f64>) {
    let bytes = std::fs::read(path).unwrap();
    let file = npyz::NpyFile::new(&bytes[..]).unwrap();
    let shape = file.shape().to_vec();
    let values = file.into_vec::<T>().unwrap();
    (shape, values.into_iter().map(Into::into).collect())
}

/// Converts the disparities in a deflated `.npz` to depths in metres; unknown disparities and depths are infinite.
pub(crate) fn write_motorcycle_depth(root: &Path, to: &Path) {
    let path = root.join("middlebury_motorcycle/motorcycle_disp.npz");
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut npy = Vec::new();
    archive.by_name("arr_0.npy").unwrap().read_to_end(&mut npy).unwrap();
    let disparity = npyz::NpyFile::new(&npy[..]).unwrap();
    // The arrays of disparities and depths are `<f4` in C order and have the same header.
    let header = npy.len() - disparity.shape().iter().product::<u64>() as usize * 4;
    // Focal length times baseline, over the sum of the disparity and the principal points' distance.
    let depth_m = |d: f32| {
        if d.is_finite() {
            (994.978 * 0.193001 / (f64::from(d) + 31.086)) as f32
        } else {
            f32::INFINITY
        }
    };
    let values = disparity.into_vec::<f32>().unwrap();
    let mut bytes = npy[..header].to_vec();
    bytes.extend(values.into_iter().flat_map(|d| depth_m(d).to_le_bytes()));
    atomic_file::write(to, &bytes).unwrap();
}

/// A photograph in linear Rec.709.
pub(crate) struct Photo {
    size: [usize; 2],
    rgb_lin: Vec<[f64; 3]>,
}

impl Photo {
    pub(crate) fn open(path: &Path) -> Self {
        let (size, values) = if path.extension().unwrap() == "npy" {
            let (shape, values) = read_npy::<f64>(path);
            ([shape[1] as usize, shape[0] as usize], values)
        } else {
            let image = image::open(path).unwrap().into_rgb8();
            let values = image.iter().map(|&code| f64::from(code) / 255.0).collect();
            ([image.width() as usize, image.height() as usize], values)
        };
        let linear = |v: f64| {
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        let rgb_lin = values.as_chunks::<3>().0.iter().map(|rgb| rgb.map(linear)).collect();
        Self { size, rgb_lin }
    }

    /// Renders the view of a 55 mm pinhole at the capture camera, `film` px square, from 16 x 16 bilinear lookups per
    /// pixel. Also returns the share of lookups outside the outermost pixel centres.
    pub(crate) fn crop(&self, set: &Set, film: usize, mirrored: bool) -> (Vec<[f64; 3]>, f64) {
        const SUB: usize = 16;
        let tan_half_fov = 36f64.hypot(24.0) / 110.0 / 2f64.sqrt();
        let [fx, fy, cx, cy] = set.intrinsics;
        // For each lookup: two texels, the fraction between them, and true if the lookup is outside.
        let axis =
            |focal_px: f64, center_px: f64, count: usize| -> Vec<(usize, usize, f64, bool)> {
                (0..film * SUB)
                    .map(|i| {
                        let tangent =
                            ((i as f64 + 0.5) / (film * SUB) as f64 * 2.0 - 1.0) * tan_half_fov;
                        let at = center_px + focal_px * tangent - 0.5;
                        let last = (count - 1) as f64;
                        let inside = at.clamp(0.0, last);
                        let first = inside.floor();
                        let next = (first + 1.0).min(last);
                        (first as usize, next as usize, inside - first, at != inside)
                    })
                    .collect()
            };
        let columns = axis(if mirrored { -fx } else { fx }, cx, self.size[0]);
        let rows = axis(fy, cy, self.size[1]);
        let mut sums = vec![[0.0; 3]; film * film];
        let mut outside = 0u64;
        for (y, &(top, bottom, fv, out_v)) in rows.iter().enumerate() {
            let row = |j: usize| &self.rgb_lin[j * self.size[0]..][..self.size[0]];
            let (top, bottom) = (row(top), row(bottom));
            for (x, &(left, right, fu, out_u)) in columns.iter().enumerate() {
                let sum = &mut sums[y / SUB * film + x / SUB];
                for c in 0..3 {
                    sum[c] += (1.0 - fv) * ((1.0 - fu) * top[left][c] + fu * top[right][c])
                        + fv * ((1.0 - fu) * bottom[left][c] + fu * bottom[right][c]);
                }
                outside += u64::from(out_u || out_v);
            }
        }
        let samples = (SUB * SUB) as f64;
        let crop = sums.into_iter().map(|sum| sum.map(|v| v / samples)).collect();
        (crop, outside as f64 / (samples * (film * film) as f64))
    }
}
