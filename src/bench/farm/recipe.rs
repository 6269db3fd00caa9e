//! Recipes of measured runs, as TOML.

/// Recipe of a run with scenes of procedural photographs.
pub(super) struct Recipe {
    /// Unique name, because measurements may share a server.
    pub(super) name: String,
    pub(super) scenes: u32,
    pub(super) film_px: [u32; 2],
    pub(super) spp: u32,
    pub(super) tile_px: u32,
    pub(super) photograph_px: [u32; 2],
}

impl Recipe {
    /// Creates a recipe of scenes with `shards` shards of 8 x 8 px and 4 samples, which cost next to nothing.
    pub(super) fn tiny(name: String, scenes: u32, shards: u32) -> Self {
        let down =
            (1..=shards).take_while(|d| d * d <= shards).filter(|d| shards.is_multiple_of(*d));
        let down = down.last().unwrap_or(1);
        Self {
            name,
            scenes,
            film_px: [shards / down * 8, down * 8],
            spp: 4,
            tile_px: 8,
            photograph_px: [64, 48],
        }
    }

    pub(super) fn text(&self) -> String {
        // Enough photographs of each place (indoors, outdoor) for a different ordered pair in every scene.
        let count = 16.max(2 * f64::from(self.scenes).sqrt().ceil() as u32 + 2);
        let ([width, height], [across, down]) = (self.film_px, self.photograph_px);
        format!(
            "schema = \"glasshouse.recipe/1\"\nname = \"{}\"\nseed = 7\n[film]\nwidth = {width}\nheight = {height}\nspp = {}\n\
             [sources.sample]\nlayout = \"sample\"\ncount = {count}\nwidth = {across}\nheight = {down}\n\
             [[split]]\nname = \"train\"\npairs = {{ sample = {} }}\n",
            self.name, self.spp, self.scenes
        )
    }
}
