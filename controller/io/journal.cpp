#include "controller/io/journal.h"

#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cassert>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <variant>

namespace reforge {
namespace {

constexpr auto kRetry = std::chrono::seconds(1);

}  // namespace

struct Journal::Waiting {
  journal::Record record;
  std::function<void(JobId)> durable;  // touched by the loop's thread alone
};

struct Journal::Shared : std::enable_shared_from_this<Shared> {
  Shared(boost::asio::io_context& context, journal::Store opened)
      : io(context), store(std::move(opened)) {}

  boost::asio::io_context& io;
  journal::Store store;  // the thread's alone

  std::mutex mutex;
  std::condition_variable wake;
  std::vector<Waiting> queue;
  bool urgent = false;
  bool ending = false;

  Journal* owner = nullptr;  // the loop's thread alone; null once it is gone
  std::thread thread;

  void run() {
    std::unique_lock lock(mutex);
    while (true) {
      wake.wait(lock, [&] { return ending || !queue.empty(); });
      if (queue.empty()) return;
      wake.wait_for(lock, kGather, [&] { return ending || urgent; });
      auto batch = std::make_shared<std::vector<Waiting>>(std::move(queue));
      queue.clear();
      urgent = false;
      lock.unlock();
      write(batch);
      lock.lock();
    }
  }

  void write(const std::shared_ptr<std::vector<Waiting>>& batch) {
    std::vector<journal::Record> records;
    records.reserve(batch->size());
    for (const Waiting& waiting : *batch) records.push_back(waiting.record);
    auto written = store.write(records);
    while (!written) {
      tell_trouble(written.error().sentence);
      {
        std::unique_lock lock(mutex);
        wake.wait_for(lock, kRetry, [&] { return ending; });
        if (ending) {
          spdlog::error("{} {} records are lost.", written.error().sentence, records.size());
          return;
        }
      }
      written = store.write(records);
    }
    boost::asio::post(io, [self = shared_from_this(), batch, added = *written] {
      if (self->owner != nullptr) self->owner->written(*batch, added);
    });
  }

  void tell_trouble(std::string sentence) {
    boost::asio::post(io, [self = shared_from_this(), text = std::move(sentence)] {
      if (self->owner != nullptr) self->owner->trouble(text);
    });
  }
};

void Journal::trouble(const std::string& sentence) {
  if (in_trouble_) return;
  in_trouble_ = true;
  handlers_.on_trouble(sentence);
}

void Journal::written(const std::vector<Waiting>& batch, const std::vector<JobId>& added) {
  if (in_trouble_) {
    in_trouble_ = false;
    handlers_.on_trouble("");
  }
  for (std::size_t i = 0; i < batch.size(); ++i) {
    if (const auto* lines = std::get_if<journal::Acknowledge>(&batch[i].record)) {
      handlers_.on_acknowledged(*lines);
    }
    if (batch[i].durable) batch[i].durable(added[i]);
  }
}

Journal::Journal(boost::asio::io_context& io, journal::Store store, Handlers handlers)
    : shared_(std::make_shared<Shared>(io, std::move(store))), handlers_(std::move(handlers)) {
  shared_->owner = this;
  shared_->thread = std::thread([shared = shared_.get()] { shared->run(); });
}

Journal::~Journal() {
  {
    const std::lock_guard lock(shared_->mutex);
    shared_->ending = true;
  }
  shared_->wake.notify_one();
  shared_->thread.join();
  shared_->owner = nullptr;
}

void Journal::write(journal::Record record, std::function<void(JobId)> durable) {
  const bool gathers = std::holds_alternative<journal::Acknowledge>(record);
  assert(!gathers || !durable);
  {
    const std::lock_guard lock(shared_->mutex);
    auto* latest = shared_->queue.empty()
                       ? nullptr
                       : std::get_if<journal::Acknowledge>(&shared_->queue.back().record);
    const auto* mine = std::get_if<journal::Acknowledge>(&record);
    if (latest != nullptr && mine != nullptr && latest->job == mine->job) {
      *latest = *mine;  // says all that the one before it said: the queue stays short
    } else {
      shared_->queue.push_back({std::move(record), std::move(durable)});
    }
    shared_->urgent = shared_->urgent || !gathers;
  }
  shared_->wake.notify_one();
}

}  // namespace reforge
