//! Plots as SVG without scripts, style sheets or fonts: axes with ticks, units and labels, lines and points.
//!
//! An [`Axis`] maps values to positions and places ticks; a [`Panel`] has two axes and draws the frame and the data.
//! The frame and its labels have the page's text colour (`currentColor`), so that a plot suits light and dark pages.

mod axis;
mod panel;
mod style;

pub(crate) use axis::Axis;
pub(crate) use panel::{Panel, Stroke, legend, plot};
pub(crate) use style::{LAYER_COLOURS, PAPER_SYMBOLS, number};
