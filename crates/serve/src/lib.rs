//! HTTP server for tree files. It serves the files themselves, with byte ranges, and responds to
//! queries about them.
//!
//! `connection.rs` handles sockets and slow clients; `routes.rs` maps addresses to handlers.
//! Queries run on blocking threads (`work.rs`: limits for concurrency and time, and cancellation
//! once no client waits). `catalog.rs` finds files by name; `opened.rs` keeps them open while they
//! are unchanged (`version.rs`). Each kind of query has its own module.

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
mod response;
mod routes;
mod server;
mod sources;
mod tiles;
mod version;
mod window;
mod work;
mod zonal;

pub use options::ServeOptions;
pub use server::Server;
