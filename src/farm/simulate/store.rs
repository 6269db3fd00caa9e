//! A model of the object store; it records which partials and tuples exist.

pub(super) struct Store {
    shards: u32,
    /// True if the store has the partial, by scene and shard.
    stored: Vec<bool>,
    /// True if any worker has traced the shard, by scene and shard.
    traced: Vec<bool>,
    tuples: Vec<bool>,
}

impl Store {
    pub(super) fn new(scenes: u32, shards: u32) -> Self {
        let none = vec![false; scenes as usize * shards as usize];
        Self { shards, stored: none.clone(), traced: none, tuples: vec![false; scenes as usize] }
    }

    fn index(&self, scene: u32, shard: u32) -> usize {
        scene as usize * self.shards as usize + shard as usize
    }

    pub(super) fn found(&self, scene: u32) -> Vec<u32> {
        (0..self.shards).filter(|&shard| self.stored[self.index(scene, shard)]).collect()
    }

    pub(super) fn put_shard(&mut self, scene: u32, shard: u32) {
        let index = self.index(scene, shard);
        self.stored[index] = true;
    }

    /// Marks a shard as traced. Returns false if it was traced before.
    pub(super) fn trace(&mut self, scene: u32, shard: u32) -> bool {
        let index = self.index(scene, shard);
        !std::mem::replace(&mut self.traced[index], true)
    }

    pub(super) fn has_tuple(&self, scene: u32) -> bool {
        self.tuples[scene as usize]
    }

    pub(super) fn put_tuple(&mut self, scene: u32) {
        self.tuples[scene as usize] = true;
    }

    pub(super) fn tuples_from(&self, scene: u32) -> usize {
        self.tuples[scene as usize..].iter().filter(|&&there| there).count()
    }

    /// Returns the first scene without a tuple, from `scene` on, or the number of scenes if all of these have one.
    pub(super) fn first_missing(&self, scene: u32) -> u32 {
        let done = self.tuples[scene as usize..].iter().take_while(|&&there| there);
        scene + done.count() as u32
    }
}
