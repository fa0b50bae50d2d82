//! The page on which a run can be watched: one self-contained HTML file, no network, no library.
//! Recordings are packed in [`course`]; the page's own style and scripts stand beside this file.

mod base64;
mod chart;
mod course;
mod fields;
mod look;
mod motion;
mod paper;
mod shapes;
mod strip;

use serde::Serialize;

pub(crate) use chart::{Axis, Figure, Ink, Inks, Key, Mark, Marker, Panel, Style};
pub(crate) use course::{PackedCourse, Story, path, told};
pub(crate) use fields::{FieldRow, SampleField, fields};
pub(crate) use look::page;
pub(crate) use paper::{ClaimLine, Paper};
pub(crate) use strip::strip;

/// Everything the page shows.
#[derive(Serialize)]
pub(crate) struct Report {
    /// Over the page.
    pub(crate) title: &'static str,
    /// Version of the program that wrote it.
    pub(crate) version: &'static str,
    /// The command that repeats it.
    pub(crate) command: String,
    /// Its seed.
    pub(crate) seed: u64,
    /// What ran the networks.
    pub(crate) backend: String,
    /// One sentence under the title.
    pub(crate) lead: String,
    /// Below the picture of the heightfield.
    pub(crate) field_caption: String,
    /// Skills in the order of their colours.
    pub(crate) palette: Vec<String>,
    /// The courses in the order of the page.
    pub(crate) courses: Vec<PackedCourse>,
}

impl Report {
    /// The whole page.
    ///
    /// # Errors
    /// When the report does not serialise.
    pub(crate) fn html(&self) -> serde_json::Result<String> {
        // `<` would let a text end the script element that holds the data.
        let data = serde_json::to_string(self)?.replace('<', "\\u003c");
        let script = [
            include_str!("course.js"),
            include_str!("scene.js"),
            include_str!("charts.js"),
            include_str!("section.js"),
            include_str!("page.js"),
        ]
        .concat();
        let mut page = include_str!("report.html").to_owned();
        for (slot, content) in [
            ("{{TITLE}}", self.title),
            ("{{TITLE}}", self.title),
            ("/*{{STYLE}}*/", include_str!("report.css")),
            ("/*{{SCRIPT}}*/", script.as_str()),
            ("/*{{DATA}}*/", data.as_str()),
        ] {
            page = page.replacen(slot, content, 1);
        }
        Ok(page)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(lead: &str) -> String {
        let report = Report {
            title: "Title",
            version: "1.2.3",
            command: "vocaloco demo --seed 7".to_owned(),
            seed: 7,
            backend: "tract".to_owned(),
            lead: lead.to_owned(),
            field_caption: String::new(),
            palette: vec!["walk".to_owned()],
            courses: Vec::new(),
        };
        report.html().unwrap()
    }

    #[test]
    fn no_text_can_end_the_data_early() {
        let page = report("</script><script>alert(1)</script>");
        assert_eq!(page.matches("</script>").count(), 2, "the data's own and the code's own");
        assert!(page.contains("\\u003c/script>"));
    }

    #[test]
    fn every_slot_is_filled_and_nothing_is_fetched() {
        let page = report("A sentence.");
        assert!(!page.contains("{{"), "a slot is left");
        // Links within the page and the names of SVG's elements are no requests.
        for request in ["src=", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest", "import("] {
            assert!(!page.contains(request), "the page holds {request}");
        }
    }
}
