//! The page of `evaluate all`: claims, figures and runs that can be watched, in one file.

use serde::Serialize;
use serde_json::Value;

use super::chart::{Figure, Inks, escaped};

/// Figures are drawn for these widths, px: a desk's and a phone's.
const WIDTHS_PX: [f64; 2] = [1060.0, 350.0];

/// A claim as the page shows it.
pub(crate) struct ClaimLine {
    pub(crate) claim: String,
    pub(crate) by: String,
    pub(crate) ours: String,
    /// A class of the style sheet: `agrees`, `differs`, `unmeasured`.
    pub(crate) verdict: &'static str,
    pub(crate) why: String,
    pub(crate) n: String,
    pub(crate) seed: u64,
    pub(crate) command: String,
    pub(crate) figure: Option<String>,
}

/// Everything the page shows.
pub(crate) struct Paper {
    pub(crate) version: &'static str,
    pub(crate) command: String,
    pub(crate) seed: u64,
    pub(crate) backend: String,
    pub(crate) lead: String,
    /// A caveat over everything, or empty.
    pub(crate) caveat: String,
    pub(crate) claims: Vec<ClaimLine>,
    /// Those of the paper's six kinds and those of ablations, each under its heading.
    pub(crate) figures: Vec<(String, Vec<Figure>)>,
    /// Packed courses.
    pub(crate) courses: Vec<Value>,
    pub(crate) palette: Vec<String>,
    pub(crate) field_caption: String,
    /// How it was made, a line each.
    pub(crate) conditions: Vec<String>,
}

/// What the page's scripts read.
#[derive(Serialize)]
struct Data<'a> {
    palette: &'a [String],
    field_caption: &'a str,
    courses: &'a [Value],
}

impl Paper {
    /// The whole page.
    ///
    /// # Errors
    /// When the courses do not serialise.
    pub(crate) fn html(&self) -> serde_json::Result<String> {
        let Self { palette, field_caption, courses, .. } = self;
        // `<` would let a text end the script element that holds the data.
        let data = serde_json::to_string(&Data { palette, field_caption, courses })?.replace('<', "\\u003c");
        let script = [
            include_str!("course.js"),
            include_str!("scene.js"),
            include_str!("charts.js"),
            include_str!("section.js"),
            include_str!("paper.js"),
        ]
        .concat();
        let style = [include_str!("report.css"), include_str!("paper.css")].concat();
        let figures: String =
            self.figures.iter().map(|(heading, figures)| chapter(heading, figures)).collect();
        let mut page = include_str!("paper.html").to_owned();
        for (slot, content) in [
            ("/*{{STYLE}}*/", style.as_str()),
            ("{{LEAD}}", &prose(&self.lead)),
            ("{{CAVEAT}}", &self.caveat()),
            ("{{SUMMARY}}", &self.summary()),
            ("{{CLAIMS}}", &self.claims()),
            ("{{FIGURES}}", &figures),
            ("{{CONDITIONS}}", &self.conditions()),
            ("/*{{SCRIPT}}*/", script.as_str()),
            ("/*{{DATA}}*/", data.as_str()),
        ] {
            page = page.replacen(slot, content, 1);
        }
        Ok(page)
    }

    fn caveat(&self) -> String {
        if self.caveat.is_empty() {
            return String::new();
        }
        format!("<p class=\"caveat\">{}</p>", prose(&self.caveat))
    }

    fn summary(&self) -> String {
        let count = |verdict: &str| self.claims.iter().filter(|claim| claim.verdict == verdict).count();
        let tile = |number: usize, class: &str, words: &str| {
            format!("<li class=\"{class}\"><b>{number}</b> {words}</li>")
        };
        [
            tile(count("agrees"), "agrees", "agree"),
            tile(count("differs"), "differs", "differ"),
            tile(count("unmeasured"), "unmeasured", "not measured"),
        ]
        .concat()
    }

    fn claims(&self) -> String {
        let claim = |(index, line): (usize, &ClaimLine)| {
            let (mark, words) = match line.verdict {
                "agrees" => ("✓", "agrees"),
                "differs" => ("✗", "differs"),
                _ => ("–", "not measured"),
            };
            let figure = line
                .figure
                .as_ref()
                .map_or(String::new(), |id| format!(" · <a href=\"#figure-{}\">figure</a>", escaped(id)));
            let command = if line.command.is_empty() {
                String::new()
            } else {
                format!(
                    "<details><summary>repeat it</summary><code>{}</code></details>",
                    escaped(&line.command)
                )
            };
            format!(
                "<article class=\"claim {}\"><h3><span class=\"mark\" aria-label=\"{words}\">{mark}</span> \
                 <span class=\"count\">{}</span> {}</h3>\
                 <p class=\"ours\"><b>Here:</b> {}</p><p class=\"why\">{}</p>\
                 <p class=\"source\">{} · n: {} · seed {}{figure}</p>{command}</article>",
                line.verdict,
                index + 1,
                prose(&line.claim),
                prose(&line.ours),
                prose(&line.why),
                escaped(&line.by),
                prose(&line.n),
                line.seed,
            )
        };
        self.claims.iter().enumerate().map(claim).collect::<Vec<_>>().concat()
    }

    fn conditions(&self) -> String {
        let lines: Vec<String> =
            self.conditions.iter().map(|line| format!("<li>{}</li>", prose(line))).collect();
        let lines = lines.concat();
        format!(
            "<ul>{lines}</ul><p>Repeat it: <code>{}</code></p><p class=\"small\">vocaloco {}, seed {}, networks run by {}.</p>",
            escaped(&self.command),
            self.version,
            self.seed,
            escaped(&self.backend)
        )
    }
}

/// Text for a paragraph: no line ends before a percent sign or inside a flag.
fn prose(text: &str) -> String {
    escaped(text).replace(" %", "\u{a0}%").replace("--", "--\u{2060}")
}

/// Figures under a heading, each drawn for a desk and for a phone.
fn chapter(heading: &str, figures: &[Figure]) -> String {
    let figure = |figure: &Figure| {
        let [wide, narrow] = WIDTHS_PX.map(|width| figure.svg(width, Inks::Page));
        format!(
            "<figure class=\"plate\" id=\"figure-{}\"><h3>{}</h3><div class=\"wide\">{wide}</div>\
             <div class=\"narrow\">{narrow}</div><figcaption>{}</figcaption></figure>\n",
            escaped(&figure.id),
            escaped(&figure.title),
            prose(&figure.caption)
        )
    };
    format!(
        "<section class=\"chapter\"><h2>{}</h2>\n{}</section>\n",
        escaped(heading),
        figures.iter().map(figure).collect::<String>()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper(claim: &str) -> String {
        let line = ClaimLine {
            claim: claim.to_owned(),
            by: "paper".into(),
            ours: "97 %".into(),
            verdict: "agrees",
            why: "by rule".into(),
            n: "100".into(),
            seed: 1,
            command: "vocaloco evaluate all".into(),
            figure: Some("success_up".into()),
        };
        let paper = Paper {
            version: "1.2.3",
            command: "vocaloco evaluate all".into(),
            seed: 1,
            backend: "tract".into(),
            lead: "A sentence.".into(),
            caveat: String::new(),
            claims: vec![line],
            figures: vec![("Results".into(), Vec::new())],
            courses: Vec::new(),
            palette: vec!["trot".into()],
            field_caption: String::new(),
            conditions: vec!["n = 100".into()],
        };
        paper.html().unwrap()
    }

    #[test]
    fn every_slot_is_filled_and_nothing_is_fetched() {
        let page = paper("Stops.");
        assert!(!page.contains("{{"), "a slot is left");
        for request in ["src=", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest", "import("] {
            assert!(!page.contains(request), "the page holds {request}");
        }
        assert!(page.contains("<b>1</b> agree") && page.contains("href=\"#figure-success_up\""));
    }

    #[test]
    fn a_claim_is_text_and_never_markup() {
        let page = paper("a < b </script><script>alert(1)");
        assert_eq!(page.matches("</script>").count(), 2, "the data's own and the code's own");
        assert!(page.contains("a &lt; b &lt;/script&gt;"));
    }
}
