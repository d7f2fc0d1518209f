//! What a team agrees on before the mission: the chart, the inputs that a link yields, and the prior over them.

use dgpc::{Inputs, Kernel, Prior, PriorMean, Reflection, Shape, Term};

use crate::chart::Chart;
use crate::event::Link;

/// Version of what a [`Model`] holds. Whoever reads one from a file or message refuses a newer version.
pub const MODEL_SCHEMA: u32 = 1;

/// The numbers that a link is turned into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputSpec {
    /// Transmitter east, north, receiver east, north, in metres: four columns.
    Positions,
    /// Transmitter east, north, depth, receiver east, north, depth, in metres: six columns. Unknown depth counts as 0.
    PositionsAndDepths,
}

impl InputSpec {
    /// Number of columns.
    pub fn dimension(self) -> usize {
        2 * self.dimension_of_an_end()
    }

    fn dimension_of_an_end(self) -> usize {
        match self {
            InputSpec::Positions => 2,
            InputSpec::PositionsAndDepths => 3,
        }
    }

    /// Swapping the two ends, as a reflection of the columns.
    ///
    /// # Errors
    /// None in practice: no column is named twice.
    pub fn swap_ends(self) -> dgpc::Result<Reflection> {
        let width = self.dimension_of_an_end();
        let pairs: Vec<(usize, usize)> = (0..width).map(|column| (column, column + width)).collect();
        Reflection::swap(&pairs)
    }
}

/// Chart, inputs and prior: all that is needed to read a link as the method does.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// [`MODEL_SCHEMA`] at the time of writing.
    pub schema: u32,
    /// The common frame.
    pub chart: Chart,
    /// The numbers that a link is turned into.
    pub inputs: InputSpec,
    /// Kernel and prior mean over those numbers; length-scales in metres.
    pub prior: Prior,
}

impl Model {
    /// A model with one isotropic kernel term over all inputs, reciprocal or not, and a zero prior mean.
    ///
    /// # Errors
    /// [`dgpc::Error::OutOfRange`] for a length-scale or variance that is not finite and positive.
    pub fn isotropic(
        chart: Chart,
        inputs: InputSpec,
        shape: Shape,
        reciprocal: bool,
        length_scale_m: f64,
        variance: f64,
    ) -> dgpc::Result<Self> {
        let mut term = Term::isotropic(shape, variance, length_scale_m, inputs.dimension())?;
        if reciprocal {
            term = term.reciprocal(inputs.swap_ends()?)?;
        }
        let prior = Prior::new(Kernel::new(vec![term])?, PriorMean::Zero)?;
        Ok(Self { schema: MODEL_SCHEMA, chart, inputs, prior })
    }

    /// The inputs of `links`: one row each, as [`InputSpec`] says, about the chart's origin.
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn inputs<'a>(&self, links: impl IntoIterator<Item = &'a Link>) -> dgpc::Result<Inputs> {
        let mut values = Vec::new();
        for link in links {
            for end in link.ends() {
                let (east_m, north_m) = self.chart.local_m(&end);
                values.extend([east_m, north_m]);
                if self.inputs == InputSpec::PositionsAndDepths {
                    values.push(end.depth_m.unwrap_or(0.0));
                }
            }
        }
        Inputs::new(values, self.inputs.dimension())
    }
}
