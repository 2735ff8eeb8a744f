// FlushDenormals: a scope in which a thread treats denormal numbers as zero.
#pragma once

namespace flockstep {

// Treats denormals as zero on this thread for the lifetime of the object. Embree requires this.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned int saved_;
};

}  // namespace flockstep
