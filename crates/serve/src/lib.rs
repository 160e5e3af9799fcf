//! A server of tree files: the files themselves, in ranges, and answers about them, over HTTP.
//!
//! A request passes from `connection.rs` (sockets, and the patience for slow ones) to `routes.rs`, which knows the addresses. What an
//! answer is made of is work for a thread that may wait (`work.rs`: how much of it at a time, for how long, and its end when nobody
//! waits any more). Files are found by their names (`catalog.rs`), and are kept open as long as they are the same
//! (`version.rs`, `opened.rs`). A module for each kind of question makes the answer.

mod answer;
mod catalog;
mod compression;
mod connection;
mod drawn;
mod failure;
mod file;
mod hosts;
mod opened;
mod options;
mod origins;
mod page;
mod parameters;
mod point;
mod range;
mod routes;
mod server;
mod tiles;
mod version;
mod window;
mod work;
mod zonal;

pub use options::ServeOptions;
pub use server::Server;
