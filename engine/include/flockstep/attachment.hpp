// Attachment: a slot of an object in which other code caches derived data. The data live as long as the object.
#pragma once

#include <memory>
#include <mutex>

namespace flockstep {

// The slot is type-erased, so the object's header does not depend on the code that uses the slot. All callers of one attachment
// must use the same T.
class Attachment {
 public:
  // Returns the value. The first call creates it with make(), which returns a std::shared_ptr<const T>. Thread-safe: other
  // callers wait for the first one. If make() throws, the next caller tries again.
  template <class T, class Make>
  const T& get(const Make& make) const {
    // A mutex instead of std::call_once: if make() throws, as it does when interrupted, some C libraries leave the once_flag in
    // a state in which the next caller waits forever.
    const std::lock_guard lock(mutex_);
    if (!value_) value_ = make();
    return *static_cast<const T*>(value_.get());
  }

 private:
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const void> value_;
};

}  // namespace flockstep
