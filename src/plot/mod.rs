//! Plots as SVG: axes with ticks, units and labels, lines and points. No script, no style sheet and no font of its own.
//!
//! An [`Axis`] maps values to positions and knows where its ticks are; a [`Panel`] has two of them and draws a frame and
//! what is in it. Lines of the frame and text take the colour of what they stand in (`currentColor`), so that one plot
//! suits a light page and a dark one.

mod axis;
mod panel;
mod style;

pub(crate) use axis::Axis;
pub(crate) use panel::{Panel, Stroke, legend, open};
pub(crate) use style::{LAYER_COLOURS, number};
