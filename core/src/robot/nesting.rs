//! A look at an MJCF before it is parsed: the parser recurses, and a stack that overflows ends the
//! process instead of the load.

/// Deepest nesting of elements; a leg of a robot is seven deep.
const MAX_DEPTH: usize = 100;

/// What was found, and what would be right.
pub(super) type Defect = (String, &'static str);

/// Checks that elements nest no deeper than a robot's, and that there is nothing in which other
/// elements could hide: no document type with its entities, no character data in brackets, no other file, whose
/// bytes nobody has checked. The parser takes an element of any prefix for one without; here it is none.
pub(super) fn check(text: &str) -> Result<(), Defect> {
    let mut depth = 0_usize;
    let mut rest = text;
    while let Some((_, tag)) = rest.split_once('<') {
        if let Some(comment) = tag.strip_prefix("!--") {
            rest = after(comment, "-->");
        } else if let Some(instruction) = tag.strip_prefix('?') {
            rest = after(instruction, "?>");
        } else if tag.starts_with('!') {
            let found = format!("<{}", tag.chars().take(10).collect::<String>());
            return Err((found, "elements and comments alone"));
        } else {
            let end = end_of(tag);
            let closes = tag.starts_with('/');
            let name =
                tag.trim_start_matches('/').split(|it: char| it.is_whitespace() || "/>".contains(it)).next();
            match name.unwrap_or_default() {
                name @ ("include" | "model" | "attach") => {
                    return Err((format!("{name} of another file"), "the whole robot in this one"));
                }
                // The parser takes one of any letters, of any number, and counts on three.
                "compiler" if tag[..end].contains("eulerseq") => {
                    return Err(("eulerseq".to_owned(), "angles about x, y and z, in this order"));
                }
                name if name.contains(':') => {
                    let found = format!("<{}", name.chars().take(40).collect::<String>());
                    return Err((found, "elements without a prefix"));
                }
                _ => {}
            }
            let is_empty = tag[..end].ends_with('/');
            rest = &tag[end..];
            depth = if closes { depth.saturating_sub(1) } else { depth + usize::from(!is_empty) };
            if depth > MAX_DEPTH {
                return Err((format!("elements more than {MAX_DEPTH} deep"), "at most 100"));
            }
        }
    }
    Ok(())
}

fn after<'a>(text: &'a str, end: &str) -> &'a str {
    text.split_once(end).map_or("", |(_, after)| after)
}

/// Where a tag ends: at the first `>` outside quotes.
fn end_of(tag: &str) -> usize {
    let mut quote = None;
    for (at, letter) in tag.char_indices() {
        match quote {
            Some(open) if letter == open => quote = None,
            None if letter == '>' => return at,
            None if letter == '"' || letter == '\'' => quote = Some(letter),
            _ => {}
        }
    }
    tag.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tower_of_bodies_is_refused_whatever_stands_between_them() {
        let tower = |between: &str| format!("<mujoco>{}", format!("<body>{between}").repeat(200));
        for between in ["", "<geom/>", "<!-- </body> -->", "<?a </body> ?>", "<a b='/'></a>"] {
            check(&tower(between)).expect_err(between);
        }
        check(&"<body name=\"/>\" a='/>'>".repeat(200)).expect_err("a quoted end is none");
        check(&"<body".repeat(200)).expect("one tag that never ends is for the parser to refuse");
    }

    #[test]
    fn entities_and_character_data_are_refused() {
        for text in ["<!DOCTYPE m [<!ENTITY a \"<body>\">]><m/>", "<m><![CDATA[</m>]]></m>"] {
            check(text).expect_err(text);
        }
    }

    #[test]
    fn another_file_is_refused_however_it_is_asked_for() {
        for text in [
            "<m><include file='a'/></m>",
            "<m xmlns:x='u'><x:include file='a'/></m>",
            "<m><include\nfile='a'/></m>",
        ] {
            check(text).expect_err(text);
        }
        check("<m><!-- no <include/> here --></m>").expect("a comment");
    }

    #[test]
    fn siblings_are_not_depth() {
        check(&format!("<?xml version='1.0'?><m>{}</m>", "<body><geom/></body><!-- <a> -->".repeat(500)))
            .expect("flat");
    }
}
