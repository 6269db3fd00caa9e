//! Plots as SVG: axes with ticks, units and labels, lines and points. No script, style sheet or font.
//!
//! An [`Axis`] maps values to positions and knows where its ticks are; a [`Panel`] has two of them and draws the frame and
//! the data. Frame and text take the page's text colour (`currentColor`), so that one plot suits a light page and a dark
//! one.

mod axis;
mod panel;
mod style;

pub(crate) use axis::Axis;
pub(crate) use panel::{Panel, Stroke, legend, plot};
pub(crate) use style::{LAYER_COLOURS, PAPER_SYMBOLS, number};
