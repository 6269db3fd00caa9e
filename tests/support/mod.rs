//! Runs the program, makes inputs, decodes outputs, and starts servers for several test binaries.
#![allow(dead_code, reason = "each test binary uses only a part of this module")]

pub(crate) mod browser;
pub(crate) mod markup;
pub(crate) mod moto;
pub(crate) mod nats;
pub(crate) mod outputs;
pub(crate) mod postconditions;
pub(crate) mod program;
pub(crate) mod s3_server;
pub(crate) mod scenes;
pub(crate) mod tools;
pub(crate) mod workplace;
