//! Starting points of the search for a structure's parameters.

use dgpc::{Kernel, Prior, Term};

use crate::model::optional_terms::OptionalTerm;
use crate::model::structure::{Part, Structure};

/// Factor of the length-scale of the range term in a further start.
const RANGE_FACTOR: f64 = 1.0 / 8.0;

/// Factor of a length-scale of the walls term in a further start.
const WALLS_FACTOR: f64 = 1.0 / 4.5;

impl Structure {
    /// Returns the prior `template`, which has the structure `self`, with the parameters of the prior `known`, which
    /// has the structure `other`. Terms that `other` lacks keep the parameters of `template`.
    pub(crate) fn transfer_parameters(
        &self,
        template: &Prior,
        (other, known): (&Structure, &Prior),
    ) -> dgpc::Result<Prior> {
        let term = |(part, term): (Part, &Term)| {
            let index = other.kernel_parts().position(|other| other == part);
            match index.and_then(|index| known.kernel().terms().get(index)) {
                Some(known) => {
                    let known = known.with_shape(term.correlations()[0].shape())?;
                    match term.reflection().filter(|_| known.reciprocity() == 1.0) {
                        Some(swap) => known.partly_reciprocal(swap.clone(), term.reciprocity()),
                        None => Ok(known),
                    }
                }
                None => Ok(term.clone()),
            }
        };
        let terms = self.kernel_parts().zip(template.kernel().terms()).map(term).collect::<dgpc::Result<_>>()?;
        Prior::new(Kernel::new(terms)?, known.mean().clone())
    }

    /// Returns starting points of a search in addition to the template or the warm start.
    ///
    /// `warm_start` holds the starting prior and the earlier structure that its parameters come from. A new range term
    /// yields the template with a much shorter length-scale of that term. The other parameters are not taken over,
    /// because other terms may have compensated for the missing one. New walls yield two starts, each with one of the
    /// two length-scales shortened.
    pub(crate) fn further_starts(
        &self,
        template: &Prior,
        warm_start: Option<(&Prior, &Self)>,
    ) -> dgpc::Result<Vec<Prior>> {
        let shorter = |prior: &Prior, term: OptionalTerm, length_scale: usize, factor: f64| {
            let part = Part::Other(term);
            let is_known = warm_start.is_some_and(|(_, earlier)| earlier.kernel_parts().any(|known| known == part));
            let index = self.kernel_parts().position(|own| own == part).filter(|_| !is_known)?;
            let mut terms = prior.kernel().terms().to_vec();
            terms[index] = terms[index].with_length_scale_times(length_scale, factor).ok()?;
            Some(Kernel::new(terms).and_then(|kernel| Prior::new(kernel, prior.mean().clone())))
        };
        let start = warm_start.map_or(template, |(start, _)| start);
        let further = [
            shorter(template, OptionalTerm::Range, 0, RANGE_FACTOR),
            shorter(start, OptionalTerm::Walls, 0, WALLS_FACTOR),
            shorter(start, OptionalTerm::Walls, 1, WALLS_FACTOR),
        ];
        further.into_iter().flatten().collect()
    }
}
