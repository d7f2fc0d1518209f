//! Runs the examples, which contain assertions.

#[path = "../../examples/fit_and_predict.rs"]
mod fit_and_predict;
#[cfg(feature = "learn")]
#[path = "../../examples/learn_kernel.rs"]
mod learn_kernel;
#[path = "../../examples/stream_of_residuals.rs"]
mod stream_of_residuals;
#[path = "../../examples/two_agents.rs"]
mod two_agents;

#[test]
fn fits_and_predicts() -> dgpc::Result<()> {
    fit_and_predict::main()
}

#[test]
fn two_agents_share() -> dgpc::Result<()> {
    two_agents::main()
}

#[test]
fn residuals_stream() -> dgpc::Result<()> {
    stream_of_residuals::main()
}

#[test]
#[cfg(feature = "learn")]
fn kernels_are_learned() -> dgpc::Result<()> {
    learn_kernel::main()
}
