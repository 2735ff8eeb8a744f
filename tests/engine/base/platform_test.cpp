#include "base/platform.hpp"

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <new>

#include "standard.hpp"

namespace flockstep {
namespace {

constexpr std::size_t kLargePage = std::size_t{2} << 20U;

struct Freed {
  void operator()(std::byte* memory) const { ::operator delete(memory, std::align_val_t{kLargePage}); }
};

std::unique_ptr<std::byte, Freed> aligned_to_large_pages(std::size_t bytes) {
  return std::unique_ptr<std::byte, Freed>(static_cast<std::byte*>(::operator new(bytes, std::align_val_t{kLargePage})));
}

// Returns true if the system accepts requests for large pages.
bool has_large_pages() {
#if defined(__linux__)
  const auto memory = aligned_to_large_pages(kLargePage);
  return madvise(memory.get(), kLargePage, MADV_HUGEPAGE) == 0;
#else
  return false;
#endif
}

// Returns true if large pages were requested for this address.
bool has_requested_large_pages(const void* address) {
  std::ifstream file("/proc/self/smaps");
  const auto wanted = reinterpret_cast<std::uintptr_t>(address);
  bool is_here = false;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::uintptr_t begin = 0, end = 0;
    char dash = 0;
    if (words >> std::hex >> begin >> dash >> end && dash == '-') is_here = begin <= wanted && wanted < end;
    if (is_here && line.starts_with("VmFlags:")) return (line + ' ').find(" hg ") != std::string::npos;
  }
  return false;
}

// The allocator may return memory for which large pages were requested before.
TEST(Platform, RequestsOnlyLargePagesThatLieCompletelyInTheMemory) {
  const auto memory = aligned_to_large_pages(3 * kLargePage);
  std::byte* const first = memory.get();
  std::byte* const third = first + 2 * kLargePage;
  const bool first_before = has_requested_large_pages(first), third_before = has_requested_large_pages(third);
  prefer_large_pages(first + 1, 3 * kLargePage - 2);
  EXPECT_EQ(has_requested_large_pages(first), first_before);
  EXPECT_EQ(has_requested_large_pages(first + kLargePage), has_large_pages());
  EXPECT_EQ(has_requested_large_pages(third), third_before);
}

TEST(Platform, RequestsNothingForMemoryWithoutACompleteLargePage) {
  const auto memory = aligned_to_large_pages(2 * kLargePage);
  std::byte* const first = memory.get();
  const bool before = has_requested_large_pages(first);
  prefer_large_pages(nullptr, 0);
  prefer_large_pages(first, 0);
  prefer_large_pages(first, kLargePage - 1);
  prefer_large_pages(first + 1, 2 * kLargePage - 2);
  EXPECT_EQ(has_requested_large_pages(first), before);
}

}  // namespace
}  // namespace flockstep
