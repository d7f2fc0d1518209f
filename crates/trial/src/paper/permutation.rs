//! One permutation of one data set: every agent alone, and the team.

use std::collections::BTreeMap;

use dgpc::{
    Certificate, Concatenation, Error, LocalityRegion, Observations, Posterior, PosteriorAtPoints, Prior, Summary,
    log_evidence,
};

use super::choice::{Choice, Fusion, Omega};
use super::data_set::DataSet;
use super::fit::{EffectiveDraws, Fit, RegionFit, average};
use super::streams::Streams;
use crate::score::Score;
use crate::split::Split;

/// Scores of one agent's points on its own held-out events in its region.
#[derive(Debug, Clone)]
pub struct LocalOutcome {
    /// Scores of the posterior at the chosen points.
    pub scores: BTreeMap<(Choice, Omega), Score>,
    /// Scores of all training events of the region.
    pub all_events: BTreeMap<Omega, Score>,
    /// Bounds on the KL divergence, at the last draw of ω.
    pub bounds: BTreeMap<Choice, Bounds>,
    /// Number of independent draws to which the chain is equivalent.
    pub effective_draws: EffectiveDraws,
}

/// The KL divergence of a sparse posterior from the full one, and its bounds, in nats.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// tr K̃, the objective of the policy.
    pub trace: f64,
    /// The divergence.
    pub kl: f64,
    /// L_upper − L_lower.
    pub gap: f64,
    /// Our closed form, which vanishes with the trace.
    pub closed_form: f64,
    /// The paper's closed form.
    pub paper_closed_form: f64,
}

/// Scores of the team on the held-out events of all regions.
#[derive(Debug, Clone)]
pub struct TeamOutcome {
    /// Scores after sharing the points of a choice.
    pub scores: BTreeMap<(Choice, Fusion, Omega), Score>,
    /// Scores with the training events of all regions in one place.
    pub centralised: BTreeMap<Omega, Score>,
}

/// Result of one permutation; `None` for an agent or team with a region without training or held-out events.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Result of every agent.
    pub local: Vec<Option<LocalOutcome>>,
    /// Result of the team.
    pub team: Option<TeamOutcome>,
}

/// One data set, divided into training and held-out events of each region.
pub(super) struct Permutation<'a> {
    pub(super) set: &'a DataSet,
    pub(super) prior: &'a Prior,
    pub(super) streams: Streams,
    /// Events of every agent's region.
    pub(super) parts: Vec<Part>,
}

/// The events of one agent's region, as indices of the log.
#[derive(Debug, Clone)]
pub struct Part {
    /// Training events.
    pub training: Vec<usize>,
    /// Held-out events.
    pub held_out: Vec<usize>,
}

impl<'a> Permutation<'a> {
    pub(super) fn new(
        set: &'a DataSet,
        prior: &'a Prior,
        regions: &[LocalityRegion],
        split: &Split,
        streams: Streams,
    ) -> Self {
        let part = |region: &LocalityRegion| {
            let (held_out, training) = region.members.iter().partition(|&&n| split.held_out[n]);
            Part { training, held_out }
        };
        Self { set, prior, streams, parts: regions.iter().map(part).collect() }
    }

    /// Whether every region has training and held-out events.
    pub(super) fn is_complete(&self) -> bool {
        self.parts.iter().all(|part| !part.training.is_empty() && !part.held_out.is_empty())
    }

    /// Fits the regions, chooses and shares points, and scores the predictions.
    pub(super) fn run(&self) -> Result<Outcome, Error> {
        let fits = self.fits()?;
        let local = fits.iter().zip(&self.parts).map(|(fit, part)| match fit {
            Some(fit) if !part.held_out.is_empty() => self.local(fit, &part.held_out).map(Some),
            _ => Ok(None),
        });
        let local = local.collect::<Result<Vec<_>, Error>>()?;
        let fits: Option<Vec<RegionFit>> = fits.into_iter().collect();
        let team = match fits {
            Some(fits) if !self.held_out().is_empty() => Some(self.team(&fits)?),
            _ => None,
        };
        Ok(Outcome { local, team })
    }

    /// Returns the fit of every agent's region; `None` without training events.
    pub(super) fn fits(&self) -> Result<Vec<Option<RegionFit>>, Error> {
        let fit = |(agent, part): (usize, &Part)| {
            if part.training.is_empty() {
                return Ok(None);
            }
            let events = self.set.observations(&part.training)?;
            RegionFit::new(self.prior, &events, &mut self.streams.agent(agent)).map(Some)
        };
        self.parts.iter().enumerate().map(fit).collect()
    }

    /// Returns the held-out events of all regions.
    pub(super) fn held_out(&self) -> Vec<usize> {
        self.parts.iter().flat_map(|part| &part.held_out).copied().collect()
    }

    fn local(&self, region: &RegionFit, held_out: &[usize]) -> Result<LocalOutcome, Error> {
        let test = self.set.observations(held_out)?;
        let (mut scores, mut all_events) = (BTreeMap::new(), BTreeMap::new());
        for omega in Omega::ALL {
            all_events
                .insert(omega, score(region.own.of(omega).iter().map(|own| own.probability(test.inputs())), &test)?);
            for choice in Choice::all() {
                let packets = region.packets(choice, omega).iter();
                let alone = |packet: &Summary| Concatenation::new(self.prior, &[packet])?.probability(test.inputs());
                scores.insert((choice, omega), score(packets.map(alone), &test)?);
            }
        }
        let (bounds, effective_draws) = (self.bounds(region)?, region.fit.effective_draws);
        Ok(LocalOutcome { scores, all_events, bounds, effective_draws })
    }

    /// Returns the bounds of every choice, at the last draw.
    fn bounds(&self, region: &RegionFit) -> Result<BTreeMap<Choice, Bounds>, Error> {
        let sites = &region.fit.sites.of(Omega::LastDraw)[0];
        let log_evidence = log_evidence(self.prior, sites)?;
        let of_choice = |choice| {
            let points = region.packets(choice, Omega::LastDraw)[0].inducing_points();
            let certificate = Certificate::new(self.prior, sites, points)?;
            let kl = certificate.divergence(log_evidence);
            let Certificate { trace, gap, closed_form, paper_closed_form, .. } = certificate;
            Ok((choice, Bounds { trace, kl, gap, closed_form, paper_closed_form }))
        };
        Choice::all().map(of_choice).collect()
    }

    fn team(&self, fits: &[RegionFit]) -> Result<TeamOutcome, Error> {
        let test = self.set.observations(&self.held_out())?;
        let mut scores = BTreeMap::new();
        for omega in Omega::ALL {
            for choice in Choice::all() {
                for fusion in [Fusion::Concatenation, Fusion::SiteFusion] {
                    scores.insert((choice, fusion, omega), self.packets_alone(fits, choice, fusion, omega, &test)?);
                }
            }
            for (choice, score) in own_and_packets(fits, omega, &test)? {
                scores.insert((choice, Fusion::OwnAndPackets, omega), score);
            }
        }
        Ok(TeamOutcome { scores, centralised: self.centralised(&test)? })
    }

    /// Returns the scores with all training events in one fit.
    fn centralised(&self, test: &Observations) -> Result<BTreeMap<Omega, Score>, Error> {
        let training: Vec<usize> = self.parts.iter().flat_map(|part| &part.training).copied().collect();
        let everything = Fit::new(self.prior, &self.set.observations(&training)?, &mut self.streams.team())?;
        let score_of = |omega| {
            // The posteriors are computed one after the other, because a posterior of all events is large.
            let sites = everything.sites.of(omega).iter();
            let predicted = sites.map(|sites| Posterior::of_sites(self.prior, sites)?.probability(test.inputs()));
            Ok((omega, score(predicted, test)?))
        };
        Omega::ALL.into_iter().map(score_of).collect()
    }

    /// Returns the score of a receiver that holds the packets of all agents and no events.
    fn packets_alone(
        &self,
        fits: &[RegionFit],
        choice: Choice,
        fusion: Fusion,
        omega: Omega,
        test: &Observations,
    ) -> Result<Score, Error> {
        let draws = 0..fits.first().map_or(0, |fit| fit.own.of(omega).len());
        let probability = |s: usize| {
            let packets: Vec<&Summary> = fits.iter().map(|fit| &fit.packets(choice, omega)[s]).collect();
            match fusion {
                Fusion::Concatenation => Concatenation::new(self.prior, &packets)?.probability(test.inputs()),
                _ => Posterior::of_summaries(self.prior, &packets)?.probability(test.inputs()),
            }
        };
        score(draws.map(probability), test)
    }
}

/// Returns the score of every choice if each agent holds its own events and the packets of the others, as a mean over
/// agents.
fn own_and_packets(fits: &[RegionFit], omega: Omega, test: &Observations) -> Result<BTreeMap<Choice, Score>, Error> {
    let mut of_agents = BTreeMap::<Choice, Vec<Score>>::new();
    for (agent, fit) in fits.iter().enumerate() {
        let own = fit.own.of(omega);
        // The choices differ in the rows of the packets alone, so the rows of the own events are prepared once.
        let at_test = own.iter().map(|own| PosteriorAtPoints::new(own, test.inputs()));
        let mut at_test = at_test.collect::<Result<Vec<_>, Error>>()?;
        for choice in Choice::all() {
            let probabilities = own.iter().zip(&mut at_test).enumerate().map(|(s, (own, at_test))| {
                let others = fits.iter().enumerate().filter(|&(other, _)| other != agent);
                let packets: Vec<&Summary> = others.map(|(_, fit)| &fit.packets(choice, omega)[s]).collect();
                let mut posterior = own.clone();
                posterior.absorb_summaries(&packets)?;
                Ok(at_test.latent(&posterior)?.probability())
            });
            of_agents.entry(choice).or_default().push(score(probabilities, test)?);
        }
    }
    let mean = |(choice, scores): (Choice, Vec<Score>)| Ok((choice, Score::mean(&scores).ok_or(NOTHING_HELD_OUT)?));
    of_agents.into_iter().map(mean).collect()
}

/// Returns the score of the mean prediction of several posteriors.
pub(super) fn score(
    probabilities: impl ExactSizeIterator<Item = Result<Vec<f64>, Error>>,
    test: &Observations,
) -> Result<Score, Error> {
    let probability = average(probabilities, test.len())?;
    Score::new(&probability, test.outcomes()).ok_or(NOTHING_HELD_OUT)
}

const NOTHING_HELD_OUT: Error =
    Error::OutOfRange { what: "number of held-out events", expected: "at least 1", value: 0.0 };
