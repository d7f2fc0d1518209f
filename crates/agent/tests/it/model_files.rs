//! Model files: they hold the whole model, and refuse what they cannot hold.

use crate::models::all_templates;
use pingmap_agent::*;

fn plain_file(model: Model) -> ModelFile {
    ModelFile { model, learned: None, site_log_digests: Vec::new() }
}

#[test]
fn a_model_file_is_read_back_to_the_same_model() {
    for (structure, model) in all_templates() {
        let learned = Provenance {
            log_digest: Some("c0ffee".to_owned()),
            from: "a \"log\".csv".to_owned(),
            structure: structure.to_string(),
            events: 10,
            events_used: 9,
            evidence: -1.25,
            leave_one_out: -0.5,
            variance_factor: 1.5,
            stop: "converged".to_owned(),
        };
        let file = ModelFile { model, learned: Some(learned), site_log_digests: Vec::new() };
        assert_eq!(ModelFile::parse(&file.write().unwrap()).unwrap(), file, "{structure}");
    }
}

#[test]
fn a_model_file_keeps_depths_and_the_reference_system() {
    let structure = Structure::default();
    let prior = structure.template(InputSpec::PositionsAndDepths, 77.0).unwrap();
    let place = Geographic { latitude_deg: 42.5, longitude_deg: -70.25 };
    for reference in [ReferenceSystem::Unknown, ReferenceSystem::About(place), ReferenceSystem::Epsg(32_619)] {
        let chart = Chart { reference, ..Chart::about([Position::new(431_234.0, 4_700_001.0)]) };
        let file = plain_file(Model::new(chart, InputSpec::PositionsAndDepths, prior.clone()));
        assert_eq!(ModelFile::parse(&file.write().unwrap()).unwrap(), file);
    }
}

#[test]
fn a_model_file_keeps_products_and_shapes_with_parameters() {
    let shape = dgpc::Shape::RationalQuadratic { alpha: 1.5 };
    let (inputs, chart) = (InputSpec::Positions, Chart::about([]));
    let path = dgpc::Correlation::isotropic(dgpc::Shape::Matern32, &[0, 1, 2, 3], 300.0).unwrap();
    let range = dgpc::Correlation::new(shape, &[8], &[150.0]).unwrap();
    let term =
        dgpc::Term::of(2.0, path).unwrap().times(range).unwrap().reciprocal(inputs.swap_ends().unwrap()).unwrap();
    let prior = dgpc::Prior::new(dgpc::Kernel::new(vec![term]).unwrap(), dgpc::PriorMean::Zero).unwrap();
    let file = plain_file(Model::new(chart, inputs, prior));
    let text = file.write().unwrap();
    assert!(text.contains("[[kernel.times]]") && text.contains("\"rational-quadratic:1.5\""), "{text}");
    assert_eq!(ModelFile::parse(&text).unwrap(), file);
    let refused = ModelFile::parse(&text.replace("rational-quadratic:1.5", "rational-cubic")).unwrap_err().to_string();
    assert!(refused.contains("rational-cubic") && refused.contains("matern32"), "{refused}");
    let refused = ModelFile::parse(&text.replace("150.0", "1e300")).unwrap_err().to_string();
    assert!(refused.contains("kernel term 1: length-scale"), "{refused}");
    let refused = ModelFile::parse(&text.replace("variance = 2.0", "")).unwrap_err().to_string();
    assert_eq!(refused, "kernel term 1: missing field `variance`");
    for key in ["variance = 2.0", "reciprocity = 0.5"] {
        let text = text.replace("[[kernel.times]]", &format!("[[kernel.times]]\n{key}"));
        let refused = ModelFile::parse(&text).unwrap_err().to_string();
        assert!(refused.contains("kernel term 1: a table `times` cannot have"), "{refused}");
    }
}
