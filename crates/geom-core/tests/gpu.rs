//! The verbs of a GPU.

use geom_core::GpuError;
use geom_core::compute::gpu::GpuBuffer;
use geom_core::compute::usage::KernelUsage;
use geom_core::shaders::Shader;
use geom_core::testing::gpu_or_skip;

const DOUBLE: Shader = Shader {
    name: "test_double",
    source: "@group(0) @binding(0) var<storage, read> a: array<u32>;
        @group(0) @binding(1) var<storage, read_write> b: array<u32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) i: vec3<u32>) {
            if i.x < arrayLength(&a) { b[i.x] = 2u * a[i.x]; }
        }",
    workgroup: [64, 1, 1],
};

#[test]
fn a_kernel_doubles_numbers() {
    let Some(gpu) = gpu_or_skip() else { return };
    let gpu = gpu.gpu();
    let input: Vec<u32> = (0..1000).collect();
    let a = gpu.upload("a", &input).unwrap();
    let b = gpu.output::<u32>("b", input.len()).unwrap();
    gpu.dispatch(&DOUBLE, &[&a, &b], [16, 1, 1]).unwrap();
    let doubled: Vec<u32> = gpu.download(&b).unwrap();
    assert_eq!(doubled, input.iter().map(|x| 2 * x).collect::<Vec<_>>());
}

#[test]
fn what_travels_counts_for_the_kernel_that_it_travels_for() {
    let Some(gpu) = gpu_or_skip() else { return };
    let gpu = gpu.gpu();
    let before = gpu.usage();
    let a = gpu.upload("a", &[1u32; 100]).unwrap();
    let [b, c] = ["b", "c"].map(|label| gpu.output::<u32>(label, 100).unwrap());
    // What no kernel was handed travels for none.
    gpu.upload("idle", &[1u32; 7]).unwrap();
    gpu.download::<u32>(&c).unwrap();
    assert!(gpu.usage().since(&before).is_empty());
    gpu.dispatch(&DOUBLE, &[&a, &b], [2, 1, 1]).unwrap();
    gpu.dispatch(&DOUBLE, &[&b, &c], [2, 3, 1]).unwrap();
    gpu.download::<u32>(&c).unwrap();
    // Nothing to do is no call.
    gpu.dispatch(&DOUBLE, &[&a, &b], [0, 1, 1]).unwrap();
    let used = gpu.usage().since(&before);
    let wanted = KernelUsage {
        calls: 2,
        workgroups: 8,
        bytes_up: 400,
        bytes_down: 400,
    };
    assert_eq!(
        used.kernels().collect::<Vec<_>>(),
        [("test_double", &wanted)]
    );
    assert_eq!(used.total(), wanted);
    // One that came up stays: it travels once.
    let before = gpu.usage();
    gpu.dispatch(&DOUBLE, &[&a, &c], [2, 1, 1]).unwrap();
    assert_eq!(gpu.usage().since(&before).total().bytes_up, 0);
}

/// What was used before starts as zeros; kernels see the length that was asked for, and together they run in order.
#[test]
fn memory_is_used_again_and_calls_may_go_together() {
    let Some(gpu) = gpu_or_skip() else { return };
    let gpu = gpu.gpu();
    for round in 0..20u32 {
        let n = 1000 + 37 * round as usize;
        let input: Vec<u32> = (0..n as u32).map(|i| i + round).collect();
        let result: Result<GpuBuffer, GpuError> = gpu.together("test", |batch| {
            let mut from = gpu.upload("a", &input)?;
            // Arrays that are dropped before the batch is handed over are still its own.
            for _ in 0..5 {
                let to = gpu.output::<u32>("b", n + 8)?;
                batch.dispatch(&DOUBLE, &[&from, &to], [n.div_ceil(64) as u32, 1, 1])?;
                from = to;
            }
            Ok(from)
        });
        let mut expected: Vec<u32> = input.iter().map(|x| 32 * x).collect();
        expected.resize(n + 8, 0);
        assert_eq!(gpu.download::<u32>(&result.unwrap()).unwrap(), expected);
        let fresh = gpu.output::<u8>("c", 4 * n + 3).unwrap();
        assert!(gpu.download::<u8>(&fresh).unwrap().iter().all(|&v| v == 0));
    }
    let failed = gpu.together("test", |_| Err::<(), _>(GpuError::NoAdapter { name: None }));
    assert_eq!(failed, Err(GpuError::NoAdapter { name: None }));
}

#[test]
fn limits_and_driver_complaints_are_errors() {
    let Some(gpu) = gpu_or_skip() else { return };
    let gpu = gpu.gpu();
    let too_large = gpu.output::<u32>("huge", usize::MAX / 8);
    assert!(matches!(too_large, Err(GpuError::TooLarge { .. })));
    let a = gpu.upload("a", &[1u32]).unwrap();
    let missing_binding = gpu.dispatch(&DOUBLE, &[&a], [1, 1, 1]);
    assert!(matches!(missing_binding, Err(GpuError::Failed { .. })));
    let many = gpu.dispatch(&DOUBLE, &[&a, &a], [u32::MAX, 1, 1]);
    assert!(matches!(many, Err(GpuError::TooManyGroups { .. })));
    // The context is still usable.
    assert_eq!(gpu.download::<u32>(&a).unwrap(), [1]);
}

#[test]
fn empty_arrays_are_fine() {
    let Some(gpu) = gpu_or_skip() else { return };
    let empty = gpu.gpu().upload::<u32>("empty", &[]).unwrap();
    assert!(gpu.gpu().download::<u32>(&empty).unwrap().is_empty());
    let few = gpu.gpu().upload("few", &[1u16, 2, 3]).unwrap();
    let first = |n| gpu.gpu().download_first::<u16>(&few, n).unwrap();
    assert_eq!(
        (first(0), first(1), first(9)),
        (vec![], vec![1], vec![1, 2, 3])
    );
}
