//! Work on all cores, with the results in order.
//!
//! The iterators of rayon are compiled anew for every closure, about 5 000 lines of LLVM each; these functions hand it one.

use std::sync::{Mutex, OnceLock};

use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// f(0), …, f(n − 1), computed on all cores.
pub fn map<R: Send + Sync>(n: usize, f: impl Fn(usize) -> R + Sync) -> Vec<R> {
    let results: Vec<OnceLock<R>> = (0..n).map(|_| OnceLock::new()).collect();
    let one = |i: usize| {
        results[i].get_or_init(|| f(i));
    };
    on_all_cores(n, &one);
    results.into_iter().filter_map(OnceLock::into_inner).collect()
}

/// What `f` returns for the number of every item and the item itself, on all cores.
pub fn each<T: Send, R: Send + Sync>(items: &mut [T], f: impl Fn(usize, &mut T) -> R + Sync) -> Vec<R> {
    let items: Vec<Mutex<&mut T>> = items.iter_mut().map(Mutex::new).collect();
    let one = |i: usize| items[i].lock().ok().map(|mut item| f(i, &mut item));
    map(items.len(), one).into_iter().flatten().collect()
}

/// The only loop that rayon compiles; a panic of `one` goes on in the caller.
fn on_all_cores(n: usize, one: &(dyn Fn(usize) + Sync)) {
    (0..n).into_par_iter().for_each(one);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_and_items_are_visited_once() {
        assert_eq!(map(1000, |i| i * i), (0..1000).map(|i| i * i).collect::<Vec<_>>());
        let mut items = vec![1; 1000];
        each(&mut items, |i, item| *item += i);
        assert!(items.iter().enumerate().all(|(i, item)| *item == i + 1));
    }
}
