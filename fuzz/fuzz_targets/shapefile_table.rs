#![no_main]

spinney_fuzz::fuzz!(shapefile_table);
