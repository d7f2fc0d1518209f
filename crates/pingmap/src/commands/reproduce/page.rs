//! The page of the experiment in Markdown.

use pingmap_trial::paper::{AtRadius, BURN_IN, DRAWS, RADIUS, RADIUS_LENGTH_SCALES};

use super::pictures::Picture;
use super::published;
use super::results::Computed;
use super::table::Table;
use super::{claims, sweep, tables};

/// Name of the figures' folder, next to the page.
pub const FIGURES: &str = "reproduction";

/// Returns the limits of the comparison with the paper.
pub fn caveat(results: &Computed) -> String {
    if results.built_in {
        return "The paper's field data are not public. Three simulated trials of the same team sizes and numbers of events replace \
                them. The order of the results can agree with the paper, the figures cannot."
            .into();
    }
    let names: Vec<&str> = results.experiment.sets().iter().map(|set| set.name.as_str()).collect();
    format!(
        "The data are {}: figures can agree with the published ones only for the paper's own data.",
        names.join(", ")
    )
}

/// Describes the kernel and the radii.
pub fn kernel_line(results: &Computed) -> String {
    let length_scale = results.experiment.length_scale();
    format!(
        "The kernel is squared-exponential with unit variance, and the prior mean is zero. One length-scale is learned from all data \
         sets together: ℓ = {length_scale:.3} (the paper's: {}). Regions have the paper's ratio r/ℓ = {RADIUS_LENGTH_SCALES}, which gives \
         r = {:.3}, and also the paper's radius r = {RADIUS}.",
        published::LENGTH_SCALE,
        RADIUS_LENGTH_SCALES * length_scale
    )
}

/// Returns the page. `command` is the command line that writes it.
pub fn markdown(results: &Computed, pictures: &[Picture], command: &str) -> String {
    let permutations = results.experiment.permutations();
    let mut page = format!(
        "{}\n\n# The paper's experiment, run again\n\n\
         Written by `{command}` (seed {}, {permutations} permutations, pingmap {}). Columns named \"published\" hold the figures of Gao, \
         He, Stilwell and McMahon, \"Decentralized Gaussian Process Classification and an Application in Subsea Robotics\". Tables I to VI \
         have the numbers of that paper. [The paper's experiment](paper-experiment.md) describes the computation.\n\n{}\n\n\
         Every agent's events are divided 65/35 into training and held-out events, {permutations} times at random. Figures are means over \
         permutations ± their standard errors. These errors describe the divisions of one data set, not other trials. \
         [A test over twenty trials](evaluation/claims.md#claims-over-simulated-trials) examines the order of the claims.\n\n\
         NLL is in nats, and lower is better. A Gibbs chain draws ω: {BURN_IN} sweeps of burn-in, then {DRAWS} draws. Three estimates are \
         compared: the last draw (the paper's choice), the average of predictions over all draws, and the mean field.\n\n",
        caveat(results),
        results.seed,
        env!("CARGO_PKG_VERSION"),
        kernel_line(results)
    );
    let everywhere = |tables: fn(&Computed, &AtRadius) -> Vec<Table>| -> String {
        let tables = results.radii.iter().flat_map(|at| tables(results, at));
        tables.map(|table| table.markdown()).collect()
    };
    let figures = pictures.iter().map(|Picture { name, caption, .. }| {
        format!("![{name}]({FIGURES}/{name}.png)\n\n{caption} ([SVG]({FIGURES}/{name}.svg))\n\n")
    });
    let data = [tables::events(results), tables::regions(results)];
    for (heading, content) in [
        ("Does the order hold?", everywhere(claims::claims)),
        ("Figures", figures.collect()),
        ("Data", data.iter().map(Table::markdown).collect()),
        ("Every agent alone", everywhere(tables::local)),
        ("The team", everywhere(tables::team)),
        ("The certificate", everywhere(tables::certificate)),
        ("Beyond one and two points", sweep::sweep(results).iter().map(Table::markdown).collect::<String>()),
    ] {
        page += &format!("## {heading}\n\n{content}");
    }
    page.trim_end().to_owned() + "\n"
}
