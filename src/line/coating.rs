//! Coatings of the faces of a pane: shares of light in place of Fresnel's.

use super::error::LineError;
use super::keys::{At, Keys, Row, Visit};
use crate::curve::Curve;
use glasshouse_keys::keys;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest number of angles of a coating.
const MOST_ANGLES: usize = 91;
/// Least difference of the cosines of neighbouring angles. A curve of smaller steps exceeds the precision of f64, and no picture shows
/// them: an angle of 0.1 degrees differs by 1.5e-6 from the normal.
const LEAST_STEP: f64 = 1.0e-6;
/// Points between two angles at which reflectance and transmittance are added up.
const POINTS: u32 = 8;

/// Shares of the light that a coated face reflects and transmits, in place of Fresnel's, for both polarisations.
#[keys]
pub struct FaceCoating {
    /// Index of the face, counted from the camera, from 0; face i lies behind i layers.
    #[key("[0, 16] whole")]
    pub face: u32,
    /// Angles of incidence of the rows of the shares, ascending from 0 to 90, at most 91: of the light outside the pane. Their cosines differ by 1e-6 or more. Without them, the shares
    /// hold for all angles.
    #[key("[0, 90] degrees")]
    pub angles_deg: Vec<f64>,
    /// Reflected share of red, green and blue for light from the camera's side, for both polarisations. With `angles_deg` a list with a
    /// row for each angle; between them, shares are monotone cubics of the cosine.
    #[key("[0, 1]")]
    pub reflectance: Shares,
    /// Reflected share for light from the other side; equal to `reflectance` without it.
    #[key("[0, 1]")]
    pub reflectance_back: Option<Shares>,
    /// Transmitted share from both sides; the coating absorbs the rest, so that the sum with a reflectance is at most 1.
    #[key("[0, 1]")]
    pub transmittance: Shares,
}

/// Shares of red, green and blue: for all angles, or a row for each angle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "shares must be [red, green, blue], or a list of such rows, one for each of angles_deg"
)]
pub enum Shares {
    Constant([f64; 3]),
    ByAngle(Vec<[f64; 3]>),
}

impl Keys for Shares {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        <[f64; 3]>::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        match self {
            Self::Constant(row) => row.numbers(at, visit),
            Self::ByAngle(rows) => rows.numbers(at, visit),
        }
    }
}

impl From<[f64; 3]> for Shares {
    fn from(row: [f64; 3]) -> Self {
        Self::Constant(row)
    }
}

impl FaceCoating {
    /// Returns shares as a function of the cosine of incidence.
    pub fn curve(&self, shares: &Shares) -> Curve {
        match shares {
            Shares::Constant(row) => Curve::constant(*row),
            Shares::ByAngle(rows) => {
                let angles = self.angles_deg.iter().rev();
                let cosines = angles.map(|deg| libm::cos(deg.to_radians())).collect();
                Curve::through(cosines, rows.iter().rev().copied().collect())
            }
        }
    }

    /// Returns the reflected shares for light from the camera's side, and from the other side.
    pub fn reflectances(&self) -> [&Shares; 2] {
        [&self.reflectance, self.reflectance_back.as_ref().unwrap_or(&self.reflectance)]
    }

    /// Returns the shares with their keys.
    fn shares(&self) -> impl Iterator<Item = (&'static str, &Shares)> {
        let front = [("reflectance", &self.reflectance)];
        let back = self.reflectance_back.as_ref().map(|shares| ("reflectance_back", shares));
        front.into_iter().chain(back).chain([("transmittance", &self.transmittance)])
    }

    fn check(&self, section: &str) -> Result<(), LineError> {
        self.check_angles(section)?;
        self.check_sums(section)
    }

    /// Checks that every list has one row for each angle, and the angles themselves.
    fn check_angles(&self, section: &str) -> Result<(), LineError> {
        let angles = &self.angles_deg;
        for (key, shares) in self.shares() {
            let found = match shares {
                Shares::ByAngle(rows) => rows.len(),
                Shares::Constant(_) if angles.is_empty() => continue,
                // A constant is valid beside lists.
                Shares::Constant(_) => angles.len(),
            };
            if found != angles.len() || angles.is_empty() {
                let field = format!("{section}.{key}");
                return Err(LineError::RowsOfCoating { field, found, angles: angles.len() });
            }
        }
        let ascends = angles.windows(2).all(|pair| pair[0] < pair[1]);
        let is_whole = angles.first() == Some(&0.0) && angles.last() == Some(&90.0);
        let field = format!("{section}.angles_deg");
        if !(angles.is_empty() || ascends && is_whole && angles.len() <= MOST_ANGLES) {
            return Err(LineError::AnglesOfCoating { field });
        }
        let cos = |deg: f64| libm::cos(deg.to_radians());
        for pair in angles.windows(2) {
            let (low, high) = (pair[0], pair[1]);
            if cos(low) - cos(high) < LEAST_STEP {
                return Err(LineError::CloseAngles { field, low, high, least: LEAST_STEP });
            }
        }
        Ok(())
    }

    /// Checks that no light is made, at the angles and between them.
    fn check_sums(&self, section: &str) -> Result<(), LineError> {
        let transmittance = self.curve(&self.transmittance);
        let between = |pair: &[f64]| {
            let (from, to) = (pair[0], pair[1]);
            (0..POINTS).map(move |i| from + (to - from) * f64::from(i) / f64::from(POINTS))
        };
        let angles: Vec<f64> = self.angles_deg.windows(2).flat_map(between).chain([90.0]).collect();
        for (key, shares) in ["reflectance", "reflectance_back"].iter().zip(self.reflectances()) {
            let reflectance = self.curve(shares);
            for deg in &angles {
                let cos = libm::cos(deg.to_radians());
                let (reflected, transmitted) = (reflectance.at(cos), transmittance.at(cos));
                for c in 0..3 {
                    let sum = reflected[c] + transmitted[c];
                    // Decimal fractions that add up to 1 may exceed it by their rounding. The comparison is false for NaN, too.
                    let is_allowed = sum <= 1.0 + 1e-9;
                    if !is_allowed {
                        let is_list = !self.angles_deg.is_empty();
                        let at = if is_list { format!(" at {deg} degrees") } else { String::new() };
                        let field = format!("{section}.{key}[{c}]{at}");
                        return Err(LineError::Light { field, sum });
                    }
                }
            }
        }
        Ok(())
    }
}

/// Checks the coatings of a pane with the faces 0 to `last`.
pub(super) fn check(coatings: &[FaceCoating], last: usize) -> Result<(), LineError> {
    for (index, coating) in coatings.iter().enumerate() {
        let face = coating.face;
        if face as usize > last {
            return Err(LineError::NoFace { index, face, last });
        }
        if coatings[..index].iter().any(|other| other.face == face) {
            return Err(LineError::FaceTwice { index, face });
        }
        coating.check(&format!("glass.coatings[{index}]"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{SceneLine, published};
    use super::*;

    fn with_coating(coating: &str) -> Result<SceneLine, String> {
        let mut line = published();
        let glass = format!(
            r#"{{"distance_m":1.0,"thickness_m":0.01,"ior":1.5,"absorption_per_m":[0.0,0.0,0.0],"tilt_deg":[0.0,0.0],"coatings":[{coating}]}}"#
        );
        line.glass = serde_json::from_str(&glass).map_err(|error| error.to_string())?;
        line.validate().map_err(|error| error.to_string())?;
        assert_eq!(serde_json::to_string(&line.glass).unwrap(), glass);
        Ok(line)
    }

    /// A line keeps its text, and curves meet their rows.
    #[test]
    fn shares_may_depend_on_angle_and_side() {
        let line = with_coating(
            r#"{"face":1,"angles_deg":[0.0,60.0,90.0],"reflectance":[[0.1,0.1,0.2],[0.2,0.2,0.2],[1.0,1.0,1.0]],"reflectance_back":[0.0,0.0,0.0],"transmittance":[[0.8,0.8,0.7],[0.7,0.7,0.7],[0.0,0.0,0.0]]}"#,
        )
        .unwrap();
        let coating = &line.glass.coatings[0];
        let [front, back] = coating.reflectances().map(|shares| coating.curve(shares));
        assert!((0..3).all(|c| (front.at(0.5)[c] - 0.2).abs() < 1e-12));
        assert_eq!((front.at(1.0), back.at(0.3)), ([0.1, 0.1, 0.2], [0.0; 3]));
        let constant = r#"{"face":0,"reflectance":[0.5,0.5,0.5],"transmittance":[0.5,0.5,0.5]}"#;
        let coating = &with_coating(constant).unwrap().glass.coatings[0];
        assert_eq!(coating.reflectances()[1], &Shares::from([0.5; 3]));
    }

    /// Sums that are not numbers are refused, although no valid share makes them.
    #[test]
    fn a_sum_must_be_a_number() {
        let line =
            with_coating(r#"{"face":0,"reflectance":[0.5,0.5,0.5],"transmittance":[0.5,0.5,0.5]}"#);
        let mut coating = line.unwrap().glass.coatings[0].clone();
        coating.transmittance = Shares::from([f64::NAN, 0.5, 0.5]);
        let error = coating.check_sums("glass.coatings[0]").unwrap_err();
        assert!(matches!(error, LineError::Light { sum, .. } if sum.is_nan()), "{error}");
        // A tenth of a degree is a valid step.
        with_coating(
            r#"{"face":1,"angles_deg":[0.0,0.1,90.0],"reflectance":[0.0,0.0,0.0],"transmittance":[[0.8,0.8,0.8],[0.7,0.7,0.7],[0.0,0.0,0.0]]}"#,
        )
        .unwrap();
    }

    #[test]
    fn errors_say_what_to_change() {
        let rows = |of: [f64; 3]| of.map(|v| format!("[{v:?},{v:?},{v:?}]")).join(",");
        let coating = |angles: &str, reflectance: &str, transmittance: &str| {
            format!(
                r#"{{"face":1,"angles_deg":[{angles}],"reflectance":{reflectance},"transmittance":[{transmittance}]}}"#
            )
        };
        let half = format!("[{}]", rows([0.5; 3]));
        for (coating, message) in [
            (
                coating("0.0,90.0", &half, &rows([0.2; 3])),
                "glass.coatings[0].reflectance has 3 rows for 2 angles",
            ),
            (
                coating("", &half, &rows([0.2; 3])).replace(r#""angles_deg":[],"#, ""),
                "glass.coatings[0].reflectance has 3 rows for 0 angles",
            ),
            (
                coating("0.0,45.0,80.0", &half, &rows([0.2; 3])),
                "glass.coatings[0].angles_deg must ascend from 0 to 90",
            ),
            (
                coating("0.0,1e-9,90.0", &half, &rows([0.2; 3])),
                "glass.coatings[0].angles_deg has 0 and 0.000000001, whose cosines differ by less than 1e-6",
            ),
            (
                coating("0.0,1e-300,90.0", &half, &rows([0.2; 3])),
                "whose cosines differ by less than 1e-6: remove one",
            ),
            (
                coating("0.0,89.99999,90.0", &half, &rows([0.2; 3])),
                "angles_deg has 89.99999 and 90, whose cosines",
            ),
            (
                coating("0.0,95.0,90.0", &half, &rows([0.2; 3])),
                "angles_deg[1] is 95, but must be 0 to 90 degrees",
            ),
            (
                coating("0.0,45.0,90.0", &format!("[{}]", rows([0.5, 2.0, 1.0])), &rows([0.0; 3])),
                "glass.coatings[0].reflectance[1][0] is 2, but must be 0 to 1",
            ),
            (
                coating("0.0,45.0,90.0", &half, &rows([0.5, 0.6, 0.5])),
                "glass.coatings[0].reflectance[0] at 5.625 degrees plus the transmittance is",
            ),
            (
                coating("0.0,45.0,90.0", &half, &rows([0.5; 3])).replace(
                    r#""transmittance""#,
                    r#""reflectance_back":[0.6,0.6,0.6],"transmittance""#,
                ),
                "glass.coatings[0].reflectance_back[0] at 0 degrees plus the transmittance is 1.1",
            ),
            (
                r#"{"face":1,"reflectance":0.5,"transmittance":[0.5,0.5,0.5]}"#.to_owned(),
                "shares must be [red, green, blue], or a list of such rows",
            ),
        ] {
            let error = with_coating(&coating).expect_err(&coating);
            assert!(error.contains(message), "{error} for {coating}");
        }
    }
}
