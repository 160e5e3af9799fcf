use super::*;

/// Systems, longitudes and latitudes, and what PROJ 9.5.1 makes of them.
const KNOWN: [(u32, f64, f64, f64, f64); 28] = [
    (4258, 12.8966, 52.082, 12.8966, 52.082),
    (4269, 159.8367, 45.9387, 159.8367, 45.9387),
    (3857, -27.1731, 55.6041, -3_024_895.655_274_7, 7_480_003.491_676_5),
    (3857, -135.4313, -47.0826, -15_076_143.353_471_1, -5_955_566.931_946_3),
    (32632, 9.7646, 79.6076, 515_397.134_870_8, 8_837_889.558_462_9),
    (32632, 9.4626, 33.3212, 543_057.090_216_3, 3_686_991.611_229_5),
    (32733, 17.8575, -76.2734, 575_662.030_604_4, 1_532_474.146_249_2),
    (25833, 12.867, 40.5877, 319_491.775_775_1, 4_495_176.072_673_4),
    (3035, -21.0478, 59.5716, 2_627_699.281_235_1, 4_431_697.193_982_6),
    (3034, 8.4641, 28.3755, 3_844_287.234_638_8, 211_004.043_058_1),
    (2154, 3.9113, 45.6012, 771_037.731_074_3, 6_500_596.705_393),
    (5070, -98.5597, 31.8952, -241_005.806_486_2, 983_351.952_172_7),
    (3413, -92.1253, 76.6583, -1_063_775.487_565_9, -987_646.193_830_6),
    (3031, 82.6003, -80.6498, 1_009_612.726_898_9, 131_120.423_473_7),
    (2193, 171.4962, -37.313, 1_466_744.143_426_6, 5_869_344.436_240_6),
    (28355, 144.2356, -23.0521, 216_732.185_319_3, 7_448_035.551_915_7),
    (3395, 135.172, -28.5454, 15_047_278.209_508_4, -3_297_498.200_857_1),
    (6933, 122.3884, 76.4851, 11_808_801.461_858_8, 7_137_164.988_147_9),
    (3347, -93.4674, 70.2553, 6_141_123.144_160_1, 3_744_148.566_889_8),
    (26912, -109.0685, 46.3196, 648_695.815_946_3, 5_131_371.175_582_2),
    (2056, 7.7076, 47.1506, 2_620_399.556_386_4, 1_222_215.656_452_4),
    (2056, 6.0622, 46.7388, 2_494_808.568_663_2, 1_177_325.393_683_7),
    (31370, 3.0044, 49.9977, 52_185.499_806_5, 77_161.647_468_9),
    (31370, 4.0247, 51.2516, 125_978.217_837_9, 215_799.273_037_5),
    (3067, 29.3292, 68.5598, 594_995.414_967_9, 7_607_076.721_924_1),
    (3067, 22.563, 63.5121, 279_333.532_156_6, 7_050_300.658_212_2),
    (8857, -116.5616, -47.7117, -9_388_498.388_023_6, -5_751_938.461_522_3),
    (8857, -95.999, -2.6766, -9_191_931.921_974_6, -343_847.077_725_8),
];

#[test]
fn places_are_those_of_proj() {
    for (number, longitude, latitude, x, y) in KNOWN {
        let projection = Projection::new(&Crs::epsg(number), false).unwrap();
        let point = projection.forward([longitude, latitude]).unwrap();
        assert!(
            (point[0] - x).abs() < 1e-3 && (point[1] - y).abs() < 1e-3,
            "EPSG:{number}: {point:?}, not {x}, {y}"
        );
        let back = projection.inverse(point).unwrap();
        // (Shifts of datums leave out heights, there and back.)
        assert!(
            (back[0] - longitude).abs() < 1e-6 && (back[1] - latitude).abs() < 1e-6,
            "EPSG:{number}: {back:?}"
        );
    }
}

#[test]
fn systems_that_cannot_be_computed_are_refused_by_name() {
    let refusal =
        |crs: Crs| Projection::new(&crs, false).err().map(|error| error.to_string()).unwrap_or_default();
    for (number, text) in [
        (4267, "NAD27"),
        (2000, "whose shift to WGS 84 is not known"),
        (27200, "nzmg"),
        (4978, "geocent"),
        (2815, "PROJ has a newer shift"),
        (3973, "PROJ has a newer shift"),
        (60_000, "which the list of definitions does not have"),
    ] {
        let refusal = refusal(Crs::epsg(number));
        assert!(refusal.contains(text) && refusal.contains(&number.to_string()), "{number}: {refusal}");
    }
    let local = Crs::parse("LOCAL_CS[\"site\",UNIT[\"m\",1]]").unwrap();
    assert!(refusal(local).contains("without an EPSG number"));
}

#[test]
fn ballpark_takes_datums_for_wgs_84_and_says_so() {
    for number in [4267, 2000, 26712, 2815] {
        let projection = Projection::new(&Crs::epsg(number), true).unwrap();
        assert!(projection.remark().unwrap().contains("hundred metres"), "{number}");
        let [x, y] = projection.forward([-63.0, 18.2]).unwrap();
        let [longitude, latitude] = projection.inverse([x, y]).unwrap();
        assert!((longitude + 63.0).abs() < 1e-6 && (latitude - 18.2).abs() < 1e-6, "{number}");
    }
    // What is known well is the same with it.
    assert!(Projection::new(&Crs::epsg(25832), true).unwrap().remark().is_none());
    // Methods that are missing stay missing.
    assert!(Projection::new(&Crs::epsg(27200), true).is_err());
}

#[test]
fn there_are_places_without_coordinates() {
    let mercator = Projection::new(&Crs::epsg(3857), false).unwrap();
    assert!(mercator.forward([0.0, 91.0]).is_none() && mercator.inverse([f64::NAN, 0.0]).is_none());
    assert!(mercator.forward([0.0, 90.0]).is_none_or(|[_, y]| y > 1e8));
    let zone = Projection::new(&Crs::epsg(32632), false).unwrap();
    assert!(zone.inverse([f64::INFINITY, 0.0]).is_none());
}
