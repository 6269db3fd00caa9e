//! A model of the object store: a bit for each shard and each tuple.

use std::ops::Range;

/// What is in the store.
#[derive(Clone, Debug)]
pub(super) struct Store {
    shards: u32,
    finished: Vec<u64>,
    traced: Vec<u64>,
    tuples: Vec<u64>,
    tuple_count: u32,
}

impl Store {
    pub(super) fn new(scenes: u32, shards: u32) -> Self {
        let words = |bits: u64| vec![0; bits.div_ceil(64) as usize];
        Self {
            shards,
            finished: words(u64::from(scenes) * u64::from(shards)),
            traced: words(u64::from(scenes) * u64::from(shards)),
            tuples: words(u64::from(scenes)),
            tuple_count: 0,
        }
    }

    fn bit(&self, scene: u32, shard: u32) -> u64 {
        u64::from(scene) * u64::from(self.shards) + u64::from(shard)
    }

    /// A shard is finished, as a partial or within a tuple.
    pub(super) fn is_finished(&self, scene: u32, shard: u32) -> bool {
        is_set(&self.finished, self.bit(scene, shard))
    }

    /// Of some shards, those that are finished.
    pub(super) fn finished_of(&self, scene: u32, shards: Range<u32>) -> Vec<u32> {
        shards.filter(|&s| self.is_finished(scene, s)).collect()
    }

    /// Every shard of the scene is finished.
    pub(super) fn is_complete(&self, scene: u32) -> bool {
        (0..self.shards).all(|s| self.is_finished(scene, s))
    }

    pub(super) fn put_shard(&mut self, scene: u32, shard: u32) {
        let bit = self.bit(scene, shard);
        set(&mut self.finished, bit);
    }

    /// Counts a shard as traced; false if it was traced before.
    pub(super) fn trace(&mut self, scene: u32, shard: u32) -> bool {
        let bit = self.bit(scene, shard);
        set(&mut self.traced, bit)
    }

    /// The scene is done.
    pub(super) fn has_tuple(&self, scene: u32) -> bool {
        is_set(&self.tuples, u64::from(scene))
    }

    pub(super) fn put_tuple(&mut self, scene: u32) {
        if set(&mut self.tuples, u64::from(scene)) {
            self.tuple_count += 1;
        }
    }

    /// Scenes that are done.
    pub(super) fn tuple_count(&self) -> u32 {
        self.tuple_count
    }

    /// The first scene from `scene` on that is not done; `scenes` if all are.
    pub(super) fn first_missing(&self, scene: u32, scenes: u32) -> u32 {
        (scene..scenes).find(|&s| !self.has_tuple(s)).unwrap_or(scenes)
    }

    /// Scenes done from `scene` on.
    pub(super) fn tuples_from(&self, scene: u32, scenes: u32) -> u32 {
        (scene..scenes).filter(|&s| self.has_tuple(s)).count() as u32
    }
}

fn is_set(words: &[u64], bit: u64) -> bool {
    words[(bit / 64) as usize] >> (bit % 64) & 1 == 1
}

/// Sets a bit; false if it was set.
fn set(words: &mut [u64], bit: u64) -> bool {
    let word = &mut words[(bit / 64) as usize];
    let fresh = *word >> (bit % 64) & 1 == 0;
    *word |= 1 << (bit % 64);
    fresh
}
