//! The rules that a network must beat: fitted to training examples, or given.

use super::EvaluateArgs;
use super::place::Place;
use crate::cli::args::SplitName;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::signals::Signals;
use compose::{Baselines, Factor, LeftOut, Rules, VeilRule, fit_baselines};

/// Ranges of numbers on the command line.
const FACTORS: std::ops::RangeInclusive<f64> = 0.01..=100.0;
const VEIL_SHARES: std::ops::RangeInclusive<f64> = 0.0..=10.0;

/// Parses `G`.
pub(super) fn parse_factor(typed: &str) -> Result<Factor, String> {
    number(typed, "factor G", &FACTORS).map(Factor)
}

/// Parses `G,K`.
pub(super) fn parse_veil(typed: &str) -> Result<VeilRule, String> {
    let Some((g, k)) = typed.split_once(',') else {
        return Err("give G,K, such as 0.88,0.8".to_owned());
    };
    let g = number(g, "factor G", &FACTORS)?;
    Ok(VeilRule { g, k: number(k, "share K", &VEIL_SHARES)? })
}

fn number(typed: &str, what: &str, allowed: &std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let (low, high) = (allowed.start(), allowed.end());
    let number: Option<f64> = typed.trim().parse().ok().filter(|number| allowed.contains(number));
    number.ok_or_else(|| format!("the {what} is a number from {low} to {high}"))
}

/// Combines the given rules with those fitted to the pictures of `--fit-to`, or for a run to its own train scenes, or
/// else with those of the first network's training. Also lists the pictures that were unusable for the fit.
pub(super) fn rules(
    args: &EvaluateArgs,
    of_networks: Option<&Baselines>,
    output: &Output,
    signals: &Signals,
) -> Result<(Rules, Vec<LeftOut>), Failure> {
    let (mut fitted, mut left_out) = (None, Vec::new());
    if args.factor.is_none() || args.veil.is_none() || args.fit_to.is_some() {
        (fitted, left_out) = baselines(args, output, signals)?;
        fitted = fitted.or_else(|| of_networks.cloned());
    }
    let rules = Rules::new(fitted, args.factor, args.veil);
    if rules.factor.is_none() || rules.veil.is_none() {
        output.note(
            "without a network or training examples, rules have rows only if they are given: --fit-to RUN|DIR fits them, --factor G and --veil G,K set them",
        );
    }
    Ok((rules, left_out))
}

/// Returns the baselines of the training examples; `None` if the command line names no examples.
fn baselines(
    args: &EvaluateArgs,
    output: &Output,
    signals: &Signals,
) -> Result<(Option<Baselines>, Vec<LeftOut>), Failure> {
    let own = Place::of_args(args).filter(|place| place.is_run);
    let place = match (&args.fit_to, own) {
        // The run of the command line may be in a store.
        (Some(folder), Some(own)) if folder == own.folder => own,
        (Some(folder), _) => Place::new(folder),
        (None, Some(own)) => own,
        (None, None) => return Ok((None, Vec::new())),
    };
    let name = place.folder.display().to_string();
    let pictures = place.pictures(SplitName::Train, args.pixels.into(), output)?;
    let (fitted, left_out) = fit_baselines(pictures.subject(), name.clone(), signals.stop())?;
    if fitted.is_none() {
        let reason = format!("nothing can be fitted to {name}: it has no readable pictures");
        if args.fit_to.is_some() {
            return Err(failure!(
                Exit::InvalidInput,
                "{reason}; `glasshouse work RUN` makes tuples"
            ));
        }
        output.note(&reason);
    }
    Ok((fitted, left_out))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_parsed_within_limits() {
        assert_eq!(parse_factor("0.83"), Ok(Factor(0.83)));
        assert_eq!(parse_veil("0.88, 0.8"), Ok(VeilRule { g: 0.88, k: 0.8 }));
        for typed in ["", "x", "0", "-1", "inf", "nan", "1e9"] {
            assert!(parse_factor(typed).is_err(), "{typed}");
        }
        for typed in ["0.88", "0.88,", "0.88,-1", "0.88,0.8,1", ",0.8"] {
            assert!(parse_veil(typed).is_err(), "{typed}");
        }
    }
}
