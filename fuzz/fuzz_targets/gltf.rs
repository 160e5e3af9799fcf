#![no_main]

spinney_fuzz::fuzz!(gltf);
