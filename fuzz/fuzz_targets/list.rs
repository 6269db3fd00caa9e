#![no_main]

#[path = "../readers.rs"]
mod readers;

libfuzzer_sys::fuzz_target!(
    init: readers::let_panics_unwind(),
    |bytes: &[u8]| {
        readers::list(bytes);
    }
);
