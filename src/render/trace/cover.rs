//! Objects that cover a part of the picture: the edges of the pane, its frame, and cards.
//!
//! The point at which a camera ray meets the plane of the front face decides for all its orders:
//!
//! ```text
//!                t_0 and T                       t_k, r_k              R (pinhole)
//! glass          through the glass               through the glass     the mirrored ray
//! frame          the frame's radiance, weight 1  0                     0
//! beside both    the unbent ray, weight 1        0                     0
//! ```
//!
//! A card between the pane and a surface mixes its radiance with that of the surface: L = c + (1 - alpha) L_behind.

mod card;
mod outline;

pub use card::Card;
pub(super) use outline::Entries;
pub use outline::Outline;

/// The objects that cover a part of the picture; none by default.
#[derive(Clone, Debug, Default)]
pub struct Cover {
    /// Edges of the pane and its frame; without them, the pane fills the picture.
    pub outline: Option<Outline>,
    /// Cards of the front and of the back (in the mirrored world), the farthest first.
    pub cards: [Vec<Card>; 2],
}

impl Cover {
    /// True if edges or cards may cover a part of R.
    pub(super) fn may_cover_clean_reflection(&self) -> bool {
        self.outline.is_some() || !self.cards[1].is_empty()
    }
}
