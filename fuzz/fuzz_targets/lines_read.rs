#![no_main]

spinney_fuzz::fuzz!(lines_read);
