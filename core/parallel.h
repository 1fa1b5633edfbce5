// A plain parallel loop over a fixed number of threads.
#pragma once

#include <functional>

namespace binrig {

/// Threads that parallel_for uses; default: the machine's cores. Set once by --jobs.
int jobs();
void set_jobs(int count);

/// Calls body(i) for i = 0 .. count-1, each once, in no particular order, on up to jobs() threads. The first exception
/// is thrown again here after all threads have stopped; later items are then not begun. Nested calls run inline.
void parallel_for(int count, const std::function<void(int)>& body);

}  // namespace binrig
