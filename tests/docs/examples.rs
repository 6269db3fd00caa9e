//! Runs the programs of `examples/`: `read_tuple` and `train_step` read the output of `render_scene`.

#[allow(dead_code, reason = "its main is not called")]
#[path = "../../examples/read_tuple.rs"]
mod read_tuple;
#[allow(dead_code, reason = "its main is not called")]
#[path = "../../examples/render_scene.rs"]
mod render_scene;
#[cfg(feature = "train")]
#[allow(dead_code, reason = "its main is not called")]
#[path = "../../examples/train_step.rs"]
mod train_step;

#[test]
fn examples_render_read_and_train() {
    let folder = tempfile::tempdir().unwrap();
    render_scene::render(folder.path()).unwrap();
    let transmitted = read_tuple::read(folder.path()).unwrap();
    // At n = 1.5 each of the two faces reflects 4 %, and slightly more at an angle.
    assert!((0.88..0.93).contains(&transmitted), "{transmitted}");
    #[cfg(feature = "train")]
    {
        let losses = train_step::train(folder.path(), 10).unwrap();
        assert!(losses[9] < losses[0], "{losses:?}");
    }
}
