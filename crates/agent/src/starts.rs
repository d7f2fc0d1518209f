//! Where the search for a structure's numbers begins.

use dgpc::{Kernel, Prior, Term};

use crate::structure::{Part, Structure};

/// By how much further starts of a search divide length-scales.
const RANGE_SHORTER: f64 = 1.0 / 8.0;
const WALL_SHORTER: f64 = 1.0 / 4.5;

impl Structure {
    /// `template`, this structure's, with the numbers of a prior of `other` structure where both have the same parts.
    ///
    /// # Errors
    /// As [`Structure::template`].
    pub(crate) fn begin_at(&self, template: &Prior, (other, known): (&Structure, &Prior)) -> dgpc::Result<Prior> {
        let term = |(part, term): (Part, &Term)| {
            let place = other.kernel_parts().position(|other| other == part);
            match place.and_then(|place| known.kernel().terms().get(place)) {
                Some(known) => known.with_shape(term.correlations()[0].shape()),
                None => Ok(term.clone()),
            }
        };
        let terms = self.kernel_parts().zip(template.kernel().terms()).map(term).collect::<dgpc::Result<_>>()?;
        Prior::new(Kernel::new(terms)?, known.mean().clone())
    }

    /// Where else a search may begin than at the template or, where there is one, at a prior of an earlier structure: for
    /// a range term that is new, at a much shorter one and the template in all else (other parts may have made up for it), and
    /// for walls that are new at such as are straight one way or the other.
    pub(crate) fn further_starts(&self, template: &Prior, begun: Option<(&Prior, &Self)>) -> dgpc::Result<Vec<Prior>> {
        let shorter = |prior: &Prior, part: Part, length_scale: usize, factor: f64| {
            let is_known = begun.is_some_and(|(_, earlier)| earlier.kernel_parts().any(|known| known == part));
            let place = self.kernel_parts().position(|own| own == part).filter(|_| !is_known)?;
            let mut terms = prior.kernel().terms().to_vec();
            terms[place] = terms[place].with_length_scale_times(length_scale, factor).ok()?;
            Some(Kernel::new(terms).and_then(|kernel| Prior::new(kernel, prior.mean().clone())))
        };
        let begin = begun.map_or(template, |(begin, _)| begin);
        let further = [
            shorter(template, Part::Range, 0, RANGE_SHORTER),
            shorter(begin, Part::Walls, 0, WALL_SHORTER),
            shorter(begin, Part::Walls, 1, WALL_SHORTER),
        ];
        further.into_iter().flatten().collect()
    }
}
