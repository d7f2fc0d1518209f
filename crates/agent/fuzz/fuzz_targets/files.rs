//! Reads any text as a model file and as a team file. It is refused, or it is written and read back to the same model
//! or team.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Chart, InputSpec, Model, ModelFile, TeamFile};

static MODEL: LazyLock<Model> = LazyLock::new(|| {
    let shape = dgpc::Shape::Matern32;
    Model::isotropic(Chart::about([]), InputSpec::Positions, shape, true, 300.0, 4.0).expect("numbers in range")
});

fuzz_target!(|text: &str| {
    if let Ok(file) = ModelFile::parse(text) {
        let written = file.write().expect("a file that was read can be written");
        assert_eq!(ModelFile::parse(&written).expect("its own text"), file);
    }
    let Ok(file) = TeamFile::parse(text) else { return };
    let Ok(team) = file.team(MODEL.clone(), None) else { return };
    let written = TeamFile::write(&team, "model.toml", None, None).expect("a file that was read can be written");
    let again = TeamFile::parse(&written).and_then(|file| file.team(MODEL.clone(), None)).expect("its own text");
    assert_eq!(again.digest(), team.digest());
});
