//! Colours and materials of a building's rooms.

use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;
use glam::Vec3;

/// Colours and materials shared by the rooms of one building.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    pub(super) wall: Material,
    pub(super) floor: Material,
    pub(super) wood: Material,
    pub(super) paint: Material,
    pub(super) cloth: Material,
    pub(super) accent: Material,
    pub(super) metal: Material,
}

/// Colours of small objects.
const ACCENTS: [u32; 10] = [
    0xb5443a, 0x2f6f7e, 0xd9a441, 0x5b7f4a, 0x7a4e6f, 0xc96f3b, 0x34507d, 0x8fa6a3, 0xd7c9a7,
    0x3d4147,
];

/// Returns a random colour for a small object.
pub(super) fn accent(r: &mut Stream) -> Vec3 {
    color(r.pick(&ACCENTS))
}

/// Returns the style of building number `building`.
pub(super) fn style(r: &mut Stream, building: usize) -> Style {
    let walls =
        [0xe6dfd0, 0xd3dcd6, 0xdcd3c8, 0xc3cfd8, 0xe3d2b8, 0xb7c4b1, 0xd9c2b6, 0xece8df, 0x8fa3a8];
    // Consecutive buildings have different walls and accents.
    let turn = r.index(2);
    let wall_a = color(walls[(4 * building + turn) % walls.len()]);
    let wall_b = color(r.pick(&walls));
    let paper = match r.index(4) {
        0 => Pattern::Stripes(0.24),
        _ => Pattern::Plain,
    };
    let woods = [
        (0x9c6b3f, 0x7c5230),
        (0xc19a6b, 0xa67f52),
        (0x6b4a33, 0x523625),
        (0xd3b48a, 0xbc9a6e),
        (0x8a5a44, 0x6e4433),
    ];
    let (wood_a, wood_b) = r.pick(&woods);
    let (floor_a, floor_b) = r.pick(&woods);
    let seed = r.seed();
    let floor =
        match r.index(5) {
            0 => Material::new(Pattern::Tiles(0.45), color(0xb9a68c), color(0x857663), seed)
                .glossy(0.05),
            1 => Material::new(Pattern::Checks(0.4), color(0xd8d2c6), color(0x6d7274), seed)
                .glossy(0.05),
            2 => Material::new(Pattern::Mottled(0.03), color(0x9a8c7c), color(0xb0a392), seed),
            _ => Material::new(Pattern::Boards(0.13), color(floor_a), color(floor_b) * 0.35, seed)
                .glossy(0.04),
        };
    let cloths = [0x8a8f96, 0x566a7a, 0xa58d6f, 0x6f7f62, 0x94564a, 0x404a5a, 0xc4b59a];
    let accents = [0xb5443a, 0x2f6f7e, 0xd9a441, 0x5b7f4a, 0x7a4e6f, 0xc96f3b, 0x34507d];
    let cloth = color(r.pick(&cloths));
    let accent = color(accents[(3 * building + turn) % accents.len()]);
    Style {
        wall: Material::new(paper, wall_a, wall_a.lerp(wall_b, 0.5), seed),
        floor,
        wood: Material::new(Pattern::Grain(false), color(wood_a), color(wood_b), seed),
        paint: plain(r.pick(&[0xe9e5db, 0xcfd6d2, 0x9fb0a8, 0xd8c8b0, 0x7f8f9c])),
        cloth: Material::new(Pattern::Cloth, cloth, cloth * 0.75, seed),
        accent: Material::plain(accent),
        metal: plain(r.pick(&[0x33373b, 0x8d8a80, 0x9a7b45])).glossy(0.08),
    }
}
