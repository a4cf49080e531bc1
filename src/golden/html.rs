//! The page that shows every failure of a check side by side. One file, no scripts; pictures by
//! relative path.

use super::artefacts::{Artefacts, picture_name};
use super::check::{AspectReport, CaseReport, CheckReport};

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
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{headline}</title>\n\
         <style>\n{STYLE}\n</style>\n<h1>{headline}</h1>\n<p>Rendered on {}.</p>\n",
        escaped(&report.adapter.to_string())
    );
    for case in report.failures() {
        add_case(&mut page, case, artefacts);
    }
    page.push_str("</html>\n");
    page
}

fn add_case(page: &mut String, case: &CaseReport, artefacts: &Artefacts) {
    let mut add = |text: String| page.push_str(&text);
    add(format!("<h2>{}</h2>\n<p>{}</p>\n<ul>\n", case.case, escaped(&case.purpose)));
    for problem in &case.problems {
        add(format!("<li>{}</li>\n", escaped(problem)));
    }
    add(format!(
        "</ul>\n<p>If the new picture is right: <code>{}</code>. \
         <a href=\"{}/numbers.json\">Numbers</a></p>\n",
        escaped(&case.bless),
        case.case
    ));
    for AspectReport { aspect, .. } in &case.aspects {
        add("<div>".to_owned());
        for role in ["expected", "actual", "difference"] {
            let name = picture_name(*aspect, role);
            if artefacts.folder(&case.case).join(&name).exists() {
                add(figure(&format!("{}/{name}", case.case), &format!("{} {role}", aspect.name())));
            }
        }
        add("</div>\n".to_owned());
    }
}

fn figure(source: &str, caption: &str) -> String {
    format!("<figure><img src=\"{source}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>")
}

fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            _ => safe.push(letter),
        }
    }
    safe
}
