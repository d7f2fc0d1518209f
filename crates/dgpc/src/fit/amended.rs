//! A sparse fit of which some events go and to which others come, the rest as it is.

use super::Fit;
use super::single::sites_and_tilts_given;
use crate::cross::{Cross, residual};
use crate::error::Result;
use crate::observations::Observations;
use crate::sites::Sites;

/// So many events get their sites at once: soon done, and each is near what it is given the others.
const AT_ONCE: usize = 8;

impl Fit {
    /// This sparse fit without some of its events, by their places, and with others behind those that stay: each at the site that it
    /// has beside all before it, told at the inducing points that are there. O(mM²) for m events that come or go, however many
    /// stay; `None` of a dense fit. What stays keeps its sites, so that this is not quite what a fit of all would find:
    /// [`Fit::mean`] and [`Fit::variance`] of these, [`Fit::evidence`], [`Fit::iterations`], [`Fit::change`] and
    /// [`Fit::converged`] are of the fit that they were found by.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
    /// let prior = Prior::new(kernel, PriorMean::Zero)?;
    /// let points = Inputs::from_rows(&[[0.0], [1.0], [2.0]])?;
    /// let events = |x: &[[f64; 1]], y| Observations::new(Inputs::from_rows(x)?, y);
    /// let first = events(&[[0.0], [0.2], [0.4]], vec![true, true, true])?;
    /// let before = fit(&prior, &first, &FitOptions::default().inducing_points(&points))?;
    /// let after = before.amended(&[0], &events(&[[1.8], [2.0]], vec![false, false])?)?.expect("it is sparse");
    /// assert_eq!(after.sites().len(), 4);
    /// let far = Inputs::from_rows(&[[2.0]])?;
    /// assert!(after.posterior()?.probability(&far)? < before.posterior()?.probability(&far)?);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`crate::sites_given`] and [`Fit::posterior`].
    pub fn amended(&self, gone: &[usize], new: &Observations) -> Result<Option<Self>> {
        let Some(mut condensed) = self.condensed.clone() else { return Ok(None) };
        condensed.forget(&self.found.sites.select(gone))?;
        let mut stays = vec![true; self.found.sites.len()];
        gone.iter().for_each(|&event| stays[event] = false);
        let staying: Vec<usize> = (0..stays.len()).filter(|&event| stays[event]).collect();
        let found = self.found.select(&staying);
        let (prior, messages) = (self.prior.clone(), self.messages.clone());
        let mut amended = Self { prior, found, messages, condensed: Some(condensed) };
        amended.append(new)?;
        Ok(Some(amended))
    }

    fn append(&mut self, new: &Observations) -> Result<()> {
        let mut known = self.posterior()?;
        let mut sites = Sites::empty(new.inputs().dimension());
        let places: Vec<usize> = (0..new.len()).collect();
        for some in places.chunks(AT_ONCE) {
            let (some, tilts) = sites_and_tilts_given(&known, &new.select(some))?;
            known.absorb_events(&some)?;
            sites.append(&some)?;
            self.found.tilts.extend(tilts);
        }
        let latent = known.latent(new.inputs())?;
        self.found.mean.extend(latent.mean);
        self.found.variance.extend(latent.variance);
        self.found.weights.extend(new.weights());
        self.found.sites.append(&sites)?;
        if let Some(condensed) = &mut self.condensed {
            condensed.observe(&sites)?;
            let cross = Cross::new(self.prior.kernel(), condensed.inducing_points(), new.inputs())?;
            self.found.residual.extend(residual(&cross, condensed.cholesky())?);
        }
        Ok(())
    }
}
