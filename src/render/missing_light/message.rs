//! What is told about missing light.

/// Light that no strategy of a render forms.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingLight {
    /// Fraction of the pixels of the crop that miss light, in (0, 1].
    pub share: f64,
    /// Fraction of the light in these pixels that is missing, in (0, 1]. Counts the light of lamps without a surface that scatters once.
    pub loss: f64,
    /// Node of the lamp whose light is missing most.
    pub lamp: String,
    /// Node of the smooth glass or mirror on most of the paths.
    pub object: String,
    /// Whether the smooth surfaces are between lamp and scattering surface only. Estimators with light subpaths form these paths.
    pub only_before: bool,
    /// Whether --max-depth leaves out most of this light, because each crossing of solid glass is a segment.
    pub too_long: bool,
    /// Whether thin glass reflects most of this light before any other smooth surface meets it. Merging leaves out such light.
    pub by_sheets: bool,
    /// Whether an estimator with light subpaths would form the paths of `only_before`: not for scans or fewer strategies.
    pub has_remedy: bool,
    /// Whether `--merge off` is the reason.
    pub is_switched_off: bool,
}

impl MissingLight {
    /// One sentence with the reason and the remedy.
    pub fn describe(&self) -> String {
        let MissingLight { share, loss, lamp, object, only_before, too_long, by_sheets, has_remedy, is_switched_off } =
            self;
        let pixels = match 100.0 * share {
            percent if percent < 1.0 => "less than 1 % of the pixels miss".into(),
            percent => format!("{percent:.0} % of the pixels miss"),
        };
        if *is_switched_off && !*too_long && !*by_sheets {
            return format!(
                "{pixels} light of '{lamp}', because it passes smooth glass or mirrors, such as '{object}', and --merge off leaves it out; \
                 use --merge auto"
            );
        }
        let loss = format!("about {:.0} % of the direct light there", (100.0 * loss).max(1.0));
        if *too_long {
            return format!(
                "{pixels} light of '{lamp}' ({loss}): it passes smooth solid glass or mirrors, such as '{object}', where each crossing is a \
                 segment, and --max-depth leaves out paths with so many segments; use a single plane in place of a pane, which costs none, \
                 or a larger --max-depth"
            );
        }
        if *by_sheets {
            let box_or_lamp = "model the pane as a closed box, or, with much more noise, use a lamp with a surface (a small emissive mesh)";
            return match only_before {
                true => format!(
                    "{pixels} light of '{lamp}' ({loss}): thin glass, such as '{object}', reflects it before a surface scatters it to the camera, \
                     and this render forms no such paths; {}",
                    if *has_remedy { "use --estimator bdpt, or a lamp with a surface" } else { box_or_lamp }
                ),
                false => format!(
                    "{pixels} light of '{lamp}' ({loss}), which has no surface: thin glass, such as '{object}', reflects it before it is \
                     scattered, the camera sees it over smooth glass, thin glass or mirrors, and no strategy forms such paths; {box_or_lamp}"
                ),
            };
        }
        let remedy = match has_remedy {
            true => "use --estimator bdpt, or a lamp with a surface",
            false => "use a lamp with a surface, or a single plane in place of a pane",
        };
        match only_before {
            true => format!(
                "{pixels} light of '{lamp}' ({loss}): it passes smooth glass or mirrors, such as '{object}', before a surface scatters it to the \
                 camera, and this render forms no such paths; {remedy}"
            ),
            false => format!(
                "{pixels} light of '{lamp}' ({loss}), which has no surface: the light passes smooth glass or mirrors, such as '{object}', both before \
                 and after it is scattered, and no strategy forms such paths; use a single plane in place of a \
                 pane; or, with much more noise, a lamp with a surface (a small emissive mesh) or a roughness of at least 0.05"
            ),
        }
    }
}
