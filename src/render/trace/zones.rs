//! Zones of the film: how much darker than the brightest the light is that the rays of each can meet, and the closed forms of rays ([`super::rough`]).
//!
//! An order takes samples in proportion to the radiance that it may show ([`super::orders`]). A lamp that is seen in one corner of the picture raises the
//! samples of the zones that may see it: those whose rays pass within bounds of its texels at any depth of the sheet. The bounds of an order are those of rays from all
//! over the film, about the centres of their pixels, and half as wide again on either side: facets have no bound. A ray beyond them is noise alone, because thinned orders are not
//! biased.

mod find;

use super::rough::Forms;

/// Width and height of a zone, px. Zones begin at multiples of this length, wherever a tile begins.
pub const ZONE_PX: u32 = 32;

/// The dimness of each order in each zone: d, if the light is at most 2^-d times the brightest of its side. Orders are numbered through: those of the front and of the back, then
/// those under smudges. Without zones, all light may be the brightest.
#[derive(Default)]
pub struct Zones {
    /// Forms of the rays behind waves and wedges.
    pub forms: Forms,
    columns: u32,
    /// Number of each zone's kind, row by row.
    kinds: Vec<usize>,
    /// The dimness of all orders in zones of each kind.
    dimness: Vec<Vec<u8>>,
}

impl Zones {
    /// Returns the kind of the zone of pixel (`x`, `y`).
    pub(super) fn kind(&self, x: u32, y: u32) -> usize {
        let zone = (y / ZONE_PX * self.columns + x / ZONE_PX) as usize;
        self.kinds.get(zone).copied().unwrap_or(0)
    }

    /// Returns the dimness of an order in zones of a kind.
    pub(super) fn of_kind(&self, kind: usize, number: usize) -> u32 {
        self.dimness.get(kind).map_or(0, |of| of[number].into())
    }

    /// Returns the dimness of an order at pixel (`x`, `y`).
    pub fn dimness(&self, (x, y): (u32, u32), number: usize) -> u32 {
        self.of_kind(self.kind(x, y), number)
    }

    /// Returns the least dimness of an order in any zone.
    pub fn least(&self, number: usize) -> u32 {
        self.dimness.iter().map(|of| of[number].into()).min().unwrap_or(0)
    }
}
