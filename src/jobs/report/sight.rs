//! Savings of models that keep only what some views see, and the changes in those views.

use super::experiments::Bench;
use super::rays::{self, Line};
use super::rows::{Costs, Drawn, Experiment, Metric};
use crate::builder::{BuildOptions, ViewedFrom};
use crate::error::Error;
use crate::load::Model;
use crate::render::NamedView;
use crate::volume::VolumeSource;

impl Bench<'_> {
    /// Models without what cannot be seen, against the whole one in the same pictures.
    pub(super) fn sights(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        whole: &Model,
        whole_costs: Costs,
    ) -> Result<Experiment, Error> {
        let voxel_mm = whole.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let (space, around) = self.lines(whole)?;
        let front = rays::front(&space, whole, self.pixels)?;
        let along = ViewedFrom::Along(NamedView::Front.looks_along());
        let choices: [(&str, Option<ViewedFrom>, &[Line]); 3] = [
            ("everything", None, &around),
            ("seen from outside", Some(ViewedFrom::Outside), &around),
            ("seen from the front", Some(along), &front),
        ];
        let mut rows = Vec::new();
        for (choice, from, lines) in choices {
            let reference = rays::cast(whole, lines, self.threads)?;
            let (met, costs) = match from {
                None => (reference.clone(), whole_costs),
                Some(from) => {
                    let options = BuildOptions { visible_from: vec![from], ..options.clone() };
                    let built = self.build(source, &options)?;
                    (rays::cast(&built.model, lines, self.threads)?, built.costs)
                }
            };
            let errors = rays::against_frame(&met, &reference, lines, (voxel_mm, 1));
            rows.push(Self::row(subject, choice, from.is_none(), costs, errors));
        }
        Ok(Experiment {
            id: "sight",
            title: "What is kept of what can be seen",
            about: "Models of what rays from there can reach, against the whole model in pictures from there: three perspective ones from outside, a parallel one from the front. What differs is counted; nothing should.".into(),
            advice: None,
            drawn: Drawn { cost: 3, metric: Metric::WrongPixels },
            rows,
            pictures: Vec::new(),
        })
    }
}
