//! The page that shows every failed case of a check side by side. It is one file without scripts,
//! and refers to pictures by relative path.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::artefacts::{Artefacts, picture_name};
use crate::report::AspectReport;
use crate::report::CaseReport;
use crate::report::CheckReport;

const STYLE: &str = "\
body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:76rem;padding:0 1rem}
body{background:#14171c;color:#dfe3ea}
h2{margin:2.5rem 0 .25rem;font-size:1.15rem}
code{background:#242a33;padding:.1rem .35rem;border-radius:4px}
li{color:#ff9d8a}
figure{display:inline-block;margin:.5rem 1rem .5rem 0}
figcaption{color:#98a2b3;font-size:.85rem}
img{image-rendering:pixelated;min-width:20rem;max-width:100%;border:1px solid #333b47;display:block}";

/// The page of a check.
pub(super) fn page(report: &CheckReport, artefacts: &Artefacts) -> String {
    let failures = report.failures().count();
    let headline = match failures {
        0 => format!("All {} golden images are as expected", report.cases.len()),
        _ => format!("{failures} of {} golden images differ", report.cases.len()),
    };
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width";
                title { (headline) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (headline) }
                p { "Rendered on " (report.adapter) "." }
                @for case in report.failures() { (section(case, artefacts)) }
            }
        }
    }
    .into_string()
}

fn section(case: &CaseReport, artefacts: &Artefacts) -> Markup {
    html! {
        h2 { (case.case) }
        p { (case.purpose) }
        ul {
            @for problem in &case.problems { li { (problem) } }
        }
        p {
            "If the new picture is right: " code { (case.bless) } ". "
            a href={ (case.case) "/numbers.json" } { "Numbers" }
        }
        @for AspectReport { aspect, .. } in &case.aspects {
            div {
                @for role in ["expected", "actual", "difference"] {
                    @let name = picture_name(*aspect, role);
                    @if artefacts.folder(&case.case).join(&name).exists() {
                        @let caption = format!("{} {role}", aspect.name());
                        figure {
                            img src={ (case.case) "/" (name) } alt=(caption);
                            figcaption { (caption) }
                        }
                    }
                }
            }
        }
    }
}
