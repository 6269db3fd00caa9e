//! A lower bound of the makespan.

use super::case::{Case, Fault};

/// Returns the time that all workers together take for the work and one load of each scene, s. Each worker
/// contributes its speed while it runs. Returns `None` if they never finish.
pub fn lower_bound_s(case: &Case) -> Option<f64> {
    let work = &case.work;
    let shards = (0..work.scenes).flat_map(|scene| (0..work.shards).map(move |s| (scene, s)));
    let traced_us: u64 = shards.map(|(scene, shard)| work.shard_us(scene, shard)).sum();
    let mut left_s = traced_us as f64 * 1e-6 + f64::from(work.scenes) * work.load_s;

    let mut speeds = vec![1.0; case.fleet.workers as usize];
    for fault in &case.faults {
        if let Fault::Slow { worker, times } = *fault {
            speeds[worker as usize] /= times;
        }
    }
    // Times at which the total speed changes, and the changes.
    let mut changes = Vec::new();
    for fault in &case.faults {
        match *fault {
            Fault::Kill { worker, at_s } => changes.push((at_s, -speeds[worker as usize])),
            Fault::Stop { worker, at_s, for_s } => {
                changes.push((at_s, -speeds[worker as usize]));
                changes.push((at_s + for_s, speeds[worker as usize]));
            }
            Fault::Slow { .. } | Fault::Wipe { .. } | Fault::Away { .. } => {}
        }
    }
    changes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut speed: f64 = speeds.iter().sum();
    let mut now_s = 0.0;
    for (at_s, change) in changes {
        if left_s <= speed * (at_s - now_s) {
            break;
        }
        left_s -= speed * (at_s - now_s);
        now_s = at_s;
        speed += change;
    }
    (speed > 1e-9).then_some(now_s + left_s / speed)
}
