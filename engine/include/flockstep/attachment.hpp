// Attachment: a slot in which other code caches what it derives from an object; it lives as long as the object.
#pragma once

#include <memory>
#include <mutex>

namespace flockstep {

// Knows no types, so that the object it belongs to need not know who uses it: all callers of one attachment agree on T.
class Attachment {
 public:
  // The value, which make() returns on first need as a std::shared_ptr<const T>. Thread-safe: whoever comes first makes it, the
  // others wait; where make() throws, the next caller tries again.
  template <class T, class Make>
  const T& get(const Make& make) const {
    // Not std::call_once: where make() throws, as it does when it is interrupted, some C libraries leave its flag in a state in
    // which the next caller waits for ever.
    const std::lock_guard lock(mutex_);
    if (!value_) value_ = make();
    return *static_cast<const T*>(value_.get());
  }

 private:
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const void> value_;
};

}  // namespace flockstep
