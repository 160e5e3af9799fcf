#![no_main]

spinney_fuzz::fuzz!(nrrd);
