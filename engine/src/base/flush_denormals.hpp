// FlushDenormals: how a thread calculates with the smallest numbers.
#pragma once

namespace flockstep {

// Denormals as zero on this thread for as long as this lives: Embree asks for it.
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
