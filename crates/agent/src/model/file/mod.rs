//! The model file, `model.toml`.

pub(crate) mod error;
pub(crate) mod terms;
pub(crate) mod site_prior;
pub(crate) mod model_file;
