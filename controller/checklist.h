// What a person confirms between a job that is ready and its start: each item by its name, each
// confirmation journalled (io/journal.h) before the job may start.
//
// A confirmation is about the rig as it stands. It is void once any job has had the rig, and after
// a restart of the daemon; the journal keeps that it was given.
#pragma once

#include <string>
#include <vector>

#include "protocols/operator_api.h"
#include "protocols/result.h"

namespace reforge {

class Checklist {
 public:
  // `prints`: the program opens the extruder module. `recovers`: it finishes an interrupted job.
  Checklist(bool prints, bool recovers);

  // The item's place, or an error that names the items there are.
  Result<std::size_t> find(const std::string& item) const;
  void confirm(std::size_t item, const std::string& who) { items_[item].by = who; }
  void forget();

  // Empty: all confirmed. Otherwise the names of what is not, as in "stock, zero".
  std::string missing() const;
  const std::vector<api::ChecklistItem>& items() const { return items_; }

 private:
  std::vector<api::ChecklistItem> items_;
};

}  // namespace reforge
