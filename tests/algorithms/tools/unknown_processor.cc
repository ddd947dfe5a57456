// An OpenBLAS that does not know the processor, for LD_PRELOAD: as long as nobody has named kernels
// (OPENBLAS_CORETYPE), it says that it fell back to its oldest ones.
#include <dlfcn.h>

#include <cstdlib>

extern "C" char* openblas_get_corename() {
  static char fallback[] = "Prescott";
  if (std::getenv("OPENBLAS_CORETYPE") == nullptr) return fallback;
  static const auto real = reinterpret_cast<char* (*)()>(dlsym(RTLD_NEXT, "openblas_get_corename"));
  return real();
}
