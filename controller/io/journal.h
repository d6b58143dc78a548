// The journal as the daemon uses it: records go to a thread of its own, which writes them in
// batches and lets the loop know when they are durable. The loop never waits for a disk.
//
// Acknowledgements may wait a moment for company (kGather); everything else goes at once, and takes
// the waiting ones along. When a batch cannot be written (disk full, file locked) `on_trouble` says
// so, nothing is dropped, and the batch is tried again each second until it is written; then
// on_trouble("") is called. `on_acknowledged` tells what has become durable of a job's lines. The
// destructor writes what is left, once. All calls and callbacks happen in the io_context's thread.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "controller/io/journal_store.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

class Journal {
 public:
  static constexpr auto kGather = std::chrono::milliseconds(50);

  struct Handlers {
    std::function<void(std::string sentence)> on_trouble;
    std::function<void(const journal::Acknowledge&)> on_acknowledged;
  };

  Journal(boost::asio::io_context& io, journal::Store store, Handlers handlers);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // `durable` is called with the number of the job it added, or 0; not for an Acknowledge, since
  // one that waits is replaced by the next.
  void write(journal::Record record, std::function<void(JobId)> durable = {});

  bool in_trouble() const { return in_trouble_; }

 private:
  struct Waiting;
  struct Shared;
  void trouble(const std::string& sentence);
  void written(const std::vector<Waiting>& batch, const std::vector<JobId>& added);

  std::shared_ptr<Shared> shared_;
  Handlers handlers_;
  bool in_trouble_ = false;
};

}  // namespace reforge
