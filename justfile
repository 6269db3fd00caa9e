# Short names of single commands. A change must pass `.ci/run`.

# all checks and tests
check:
    .ci/run

# format, lints and unit tests: under two minutes after a build
quick:
    cargo fmt --check
    cargo clippy --release --workspace -- -D warnings
    cargo test --release --workspace --lib

# all files that are made from the code: schemas and tables of keys; the tests fail if they are stale
generate:
    UPDATE_EXPECT=1 cargo test --release -p glasshouse-line -p glasshouse-plan --lib generated

build:
    cargo build --release

test:
    cargo test --release

# all crash points and failing calls: minutes
crash:
    cargo test --release --test crash -- --ignored --nocapture --test-threads 1 any_crash every_failing

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
