//! The gauntlet as a page: its tables, and pictures of the worst drives. All in one file.

use super::drive::Row;
use super::judgement::Verdict;
use super::{PICTURES, Results, table};
use std::collections::BTreeMap;
use std::fmt::Write as _;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2rem auto;padding:0 1rem;color:#14181f}\
    table{border-collapse:collapse;margin:1rem 0}td,th{border-bottom:1px solid #e1e5ea;padding:.2rem .7rem;text-align:left}\
    figure{display:inline-block;margin:.6rem;width:420px;vertical-align:top}figure svg{width:100%;height:auto;border:1px solid #e1e5ea}\
    figcaption{font-size:13px}.key b{padding:0 .4rem}";

/// The page; `pictures` are those of drives that are not right, by seed.
pub(super) fn page(results: &Results<'_>, pictures: &[(u64, Option<String>)], preset: &str) -> String {
    let tables = html_tables(&table::markdown(results, preset, &[]));
    let pictures: BTreeMap<u64, &str> =
        pictures.iter().filter_map(|(seed, picture)| Some((*seed, picture.as_deref()?))).collect();
    let mut shown: Vec<&Row> = table::worst(results.rows);
    let mut told: Vec<&Row> = results.rows.iter().filter(|row| row.outcome == Verdict::Told).collect();
    told.sort_by(|a, b| b.result.max_m.total_cmp(&a.result.max_m).then(a.seed.cmp(&b.seed)));
    shown.extend(told);
    let mut figures = String::new();
    for row in shown.into_iter().filter(|row| pictures.contains_key(&row.seed)).take(PICTURES) {
        let _ = write!(
            figures,
            "<figure>{}<figcaption><b>{}: {}</b>, {:.2} m claimed wrongly, odometry {:.2} m<br>{}, {}, {}<br>fault: {}</figcaption></figure>",
            pictures[&row.seed],
            row.seed,
            row.outcome.name(),
            row.claimed_max_m(),
            row.odometry_max_m,
            row.world,
            row.base,
            table::lidar(row),
            row.fault
        );
    }
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Gauntlet</title><style>{STYLE}</style><h1>Gauntlet</h1>{tables}\
         <h2>The worst drives</h2><p class=\"key\"><b style=\"color:#16a34a\">truth</b><b style=\"color:#2563eb\">odometry</b>\
         <b style=\"color:#f59e0b\">live</b><b style=\"color:#dc2626\">result</b>dotted where the robot is said to be lost</p>{figures}</html>\n"
    )
}

/// Markdown's tables and paragraphs as HTML.
fn html_tables(markdown: &str) -> String {
    let escaped = markdown.replace('&', "&amp;").replace('<', "&lt;");
    let mut html = String::new();
    let mut is_in_table = false;
    for line in escaped.lines() {
        let cells = line.strip_prefix("| ").and_then(|rest| rest.strip_suffix(" |"));
        match cells {
            Some(cells) => {
                let tag = if is_in_table { "td" } else { "th" };
                if !is_in_table {
                    html.push_str("<table>");
                }
                is_in_table = true;
                let cells: String = cells.split(" | ").map(|cell| format!("<{tag}>{cell}</{tag}>")).collect();
                let _ = write!(html, "<tr>{cells}</tr>");
            }
            None if line.starts_with("|---") => {}
            None => {
                if std::mem::take(&mut is_in_table) {
                    html.push_str("</table>");
                }
                if !line.is_empty() {
                    let _ = write!(html, "<p>{line}</p>");
                }
            }
        }
    }
    if is_in_table { html + "</table>" } else { html }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_become_tables() {
        let html = html_tables("a < b\n\n| x | y |\n|---|---|\n| 1 | 2 |\n");
        assert_eq!(html, "<p>a &lt; b</p><table><tr><th>x</th><th>y</th></tr><tr><td>1</td><td>2</td></tr></table>");
    }
}
