// Picture: the colours of a frame. PictureMemory: the memory of pictures that are no longer needed, for the next ones. New memory
// of this size costs more than the copy of the colours into it. FileMemory: the files of the latest pictures.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <list>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace flockstep::server {

struct Picture {
  std::vector<std::uint8_t> rgb;  // from row to row, from the top
  int width_px = 0, height_px = 0;
  friend bool operator==(const Picture&, const Picture&) = default;
};

class PictureMemory {
 public:
  std::vector<std::uint8_t> take() {
    const std::scoped_lock lock(mutex_);
    if (spare_.empty()) return {};
    std::vector<std::uint8_t> memory = std::move(spare_.back());
    spare_.pop_back();
    bytes_ -= memory.capacity();
    return memory;
  }
  void give_back(std::vector<std::uint8_t> memory) {
    constexpr std::size_t kMost = std::size_t{1} << 24;
    const std::scoped_lock lock(mutex_);
    if (bytes_ + memory.capacity() > kMost) return;
    bytes_ += memory.capacity();
    spare_.push_back(std::move(memory));
  }

 private:
  std::mutex mutex_;
  std::vector<std::vector<std::uint8_t>> spare_;
  std::size_t bytes_ = 0;
};

// Keeps the file of the latest picture of each view. A view that shows the same colours again, whatever made them, need not be
// compressed again.
class FileMemory {
 public:
  explicit FileMemory(std::size_t max_bytes = std::size_t{1} << 25U) : max_bytes_(max_bytes) {}

  // Names a picture: its camera and drone, and the settings of its file.
  struct View {
    std::string camera;
    std::int64_t drone = 0;
    std::int32_t format = 0;
    std::uint32_t quality = 0;
    friend bool operator==(const View&, const View&) = default;
  };

  // Returns the file of a picture, by make(picture) if the latest one of this view has other colours. Keeps the picture, and
  // leaves in its place memory that is no longer needed.
  template <class Make>
  std::string file_of(const View& view, Picture& picture, const Make& make) {
    {
      const std::scoped_lock lock(mutex_);
      const auto found = std::ranges::find(entries_, view, &Entry::view);
      if (found != entries_.end() && found->picture == picture) {
        entries_.splice(entries_.begin(), entries_, found);
        return found->file;
      }
    }
    std::string file = make(picture);
    const std::scoped_lock lock(mutex_);
    auto entry = std::ranges::find(entries_, view, &Entry::view);
    if (entry == entries_.end()) entry = entries_.insert(entries_.begin(), Entry{.view = view});
    bytes_ -= entry->bytes();
    std::swap(entry->picture, picture);
    entry->file = file;
    bytes_ += entry->bytes();
    entries_.splice(entries_.begin(), entries_, entry);
    while (bytes_ > max_bytes_) {
      bytes_ -= entries_.back().bytes();
      entries_.pop_back();
    }
    return file;
  }

  std::size_t bytes() const { return bytes_; }

 private:
  struct Entry {
    View view;
    Picture picture{};
    std::string file{};
    std::size_t bytes() const { return picture.rgb.capacity() + file.size(); }
  };

  std::size_t max_bytes_;
  std::mutex mutex_;
  std::list<Entry> entries_;  // the latest first
  std::size_t bytes_ = 0;
};

}  // namespace flockstep::server
