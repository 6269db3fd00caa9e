//! Warning of jumps of the loss, the sign of an unstable training.

/// Loss of a step over the median of all steps from which a step counts as a jump.
const JUMP: f32 = 10.0;

/// Returns a warning if the losses of steps, all finite, jump: `None` for a stable training.
pub(super) fn warning_of_jumps(losses: &[f32]) -> Option<String> {
    let mut sorted = losses.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    let median = *sorted.get(sorted.len() / 2)?;
    // A long training begins with losses far above its median.
    let after_start = losses.iter().skip_while(|loss| **loss > median);
    let jumps: Vec<f32> = after_start.copied().filter(|loss| *loss > JUMP * median).collect();
    let (count, largest) = (jumps.len(), jumps.iter().copied().fold(0.0, f32::max));
    (count > 0).then(|| {
        format!(
            "the loss exceeds {JUMP} times its median, {median:.3}, in {count} of {} steps, and reaches {largest:.3}; a smaller learning rate may help",
            losses.len()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_jumps_are_reported() {
        let mut losses = vec![0.1; 50];
        assert_eq!(warning_of_jumps(&[]), None);
        assert_eq!(warning_of_jumps(&losses), None);
        (losses[0], losses[7]) = (2000.0, 0.9);
        assert_eq!(warning_of_jumps(&losses), None);
        (losses[3], losses[49]) = (1.5, 600.0);
        let warning = warning_of_jumps(&losses).unwrap();
        assert!(
            warning.contains("median, 0.100, in 2 of 50 steps, and reaches 600.000;"),
            "{warning}"
        );
    }
}
