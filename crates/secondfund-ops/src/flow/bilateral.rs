//! The bilateral filter of normals.

use geom_core::Vector3;
use geom_core::compute::parallel;

use super::sheet::Sheet;
use crate::Error;
use crate::backend::On;

/// Normals of faces averaged over the faces around them, those nearby in place and direction most (Zheng, Fu, Au and
/// Tai, *Bilateral normal filtering for mesh denoising*, 2011, the local scheme).
///
/// Neighbours are the faces that share a vertex. The width in space is the mean distance of the middles of neighbours,
/// so that only `range` has to be chosen. Each round reads the normals of the one before; positions and areas stay
/// those of the input.
pub(super) fn filtered<const N: usize>(
    sheet: &Sheet,
    faces: &[[u32; N]],
    rounds: usize,
    range: f64,
    run: On<'_>,
) -> Result<Vec<Vector3>, Error> {
    let (count, centers) = (faces.len(), &sheet.centers);
    let neighbors: Vec<Vec<u32>> = parallel::map(count, |t| {
        let around = faces[t].iter().flat_map(|&v| sheet.around(v as usize));
        let mut others: Vec<u32> = around.copied().filter(|&f| f as usize != t).collect();
        others.sort_unstable();
        others.dedup();
        others
    });
    let apart = |t: usize| {
        neighbors[t]
            .iter()
            .map(|&f| (centers[f as usize] - centers[t]).norm())
            .sum::<f64>()
    };
    let pairs: usize = neighbors.iter().map(Vec::len).sum();
    let reach = parallel::sum(count, apart) / pairs.max(1) as f64;
    let mut normals = sheet.normals.clone();
    for round in 0..rounds {
        run.progress("normals", round as u64, rounds as u64)?;
        normals = parallel::map(count, |t| {
            let sum: Vector3 = neighbors[t]
                .iter()
                .map(|&f| {
                    let f = f as usize;
                    let near = (centers[f] - centers[t]).norm_squared() / (2.0 * reach * reach);
                    let alike = (normals[f] - normals[t]).norm_squared() / (2.0 * range * range);
                    normals[f] * (sheet.areas[f] * (-near - alike).exp())
                })
                .sum();
            (sum + normals[t] * sheet.areas[t])
                .try_normalize(0.0)
                .unwrap_or(normals[t])
        });
    }
    Ok(normals)
}
