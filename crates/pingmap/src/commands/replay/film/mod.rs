//! The film of a mission: a page that shows the map of each vehicle at some times, with tracks and transmissions.

mod data;
mod recorder;
mod page;

pub use page::page;
pub use recorder::Recorder;
