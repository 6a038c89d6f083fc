//! The look of everything that people read: self-contained pages, charts, tables of text, numbers and units.
//!
//! A leaf that knows nothing of what is shown: every verb that writes a page or a table does it with this.

pub mod flow;
pub mod format;
pub mod histogram;
pub mod plot;
pub mod scatter;
pub mod text;
pub mod unit;

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");
/// Forbids any fetch, so that a page cannot grow a dependency unseen.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

/// A whole page around its content: no scripts, no fonts or images from elsewhere. It follows the reader's
/// choice of light or dark.
#[must_use]
pub fn document(title: &str, content: &Markup) -> String {
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { (content) } }
        }
    };
    markup.into_string()
}

/// The head of a page: what made it, its title, and in one sentence what it says. `good` gives it a badge.
#[must_use]
pub fn masthead(verb: &str, title: &str, good: Option<bool>, statement: &str) -> Markup {
    html! {
        header.masthead {
            p.eyebrow { "Cardan · " (verb) }
            div.verdict .pass[good == Some(true)] .fail[good == Some(false)] {
                @match good {
                    Some(true) => span.badge { "✓ Pass" },
                    Some(false) => span.badge { "✗ Fail" },
                    None => {},
                }
                h1 { (title) }
            }
            p.statement { (statement) }
        }
    }
}

/// A section with its heading and one sentence that says how to read it.
#[must_use]
pub fn framed(id: &str, title: &str, lead: &str, content: &Markup) -> Markup {
    html! {
        section id=(id) {
            header { h2 { (title) } p.lead { (lead) } }
            (content)
        }
    }
}

/// The command that makes the page again.
#[must_use]
pub fn reproduce(command: &str) -> Markup {
    framed(
        "reproduce",
        "Reproduce",
        "The same command with the same seed gives the same figures.",
        &html! { pre { code { (command) } } },
    )
}
