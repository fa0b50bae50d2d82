//! The page on which a run can be watched: one self-contained HTML file, no network, no library.
//! Recordings are packed in [`course`]; the page's own style and scripts stand beside this file.

mod base64;
mod course;

use serde::Serialize;

pub(crate) use course::{PackedCourse, Story, path};

/// Everything the page shows.
#[derive(Serialize)]
pub(crate) struct Report {
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
            include_str!("page.js"),
        ]
        .concat();
        let mut page = include_str!("report.html").to_owned();
        for (slot, content) in [
            ("/*{{STYLE}}*/", include_str!("report.css")),
            ("/*{{SCRIPT}}*/", script.as_str()),
            ("/*{{DATA}}*/", data.as_str()),
        ] {
            page = page.replacen(slot, content, 1);
        }
        Ok(page)
    }
}
