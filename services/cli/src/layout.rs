//! The layouts of the viewer, as an argument.

use shared_types::scenario::Layout;

pub(crate) fn layout(text: &str) -> Result<Layout, String> {
    let found = Layout::ALL.into_iter().find(|layout| layout.name() == text);
    found.ok_or_else(|| "there are control and timing".to_owned())
}
