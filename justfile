# Each line is one command; `.ci/run` is what decides.

# all checks and tests
check:
    .ci/run

# under two minutes when warm: form, rules, lints, optics
quick:
    cargo fmt --check
    cargo clippy --release --workspace -- -D warnings
    cargo test --release --workspace --lib

build:
    cargo build --release

test:
    cargo test --release

fmt:
    cargo fmt

lint:
    cargo clippy --release --all-targets -- -D warnings

doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --release

bench:
    cargo bench

smoke:
    cargo run --release -- run manifests/smoke.toml
