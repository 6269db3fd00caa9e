//! Shares of light that a coated face reflects and transmits, in place of Fresnel's.

use glasshouse_line::curve::Curve;

/// Shares of the light that a coated face reflects and transmits, for s and p.
#[derive(Clone, Debug, PartialEq)]
pub struct Coating {
    /// Reflectance for light from the camera's side.
    pub reflectance: Curve,
    /// Reflectance for light from the other side.
    pub reflectance_back: Curve,
    /// Transmittance, equal for both directions (Helmholtz). The coating absorbs the rest.
    pub transmittance: Curve,
}

impl Coating {
    /// Makes a coating that is equal at all angles and from both sides.
    pub fn constant(reflectance: [f64; 3], transmittance: [f64; 3]) -> Self {
        let [reflectance, transmittance] = [reflectance, transmittance].map(Curve::constant);
        Self { reflectance_back: reflectance.clone(), reflectance, transmittance }
    }

    /// Returns the reflectance for light that travels away from the camera (`inward`) or towards it.
    pub fn reflectance(&self, inward: bool) -> &Curve {
        if inward { &self.reflectance } else { &self.reflectance_back }
    }

    /// Returns the reflectance or the transmittance for light of this direction.
    pub(in super::super) fn share(&self, inward: bool, reflects: bool) -> &Curve {
        if reflects { self.reflectance(inward) } else { &self.transmittance }
    }

    /// True if the colours differ.
    pub(super) fn is_coloured(&self) -> bool {
        [&self.reflectance, &self.reflectance_back, &self.transmittance]
            .into_iter()
            .any(Curve::is_coloured)
    }
}
