// A job folder in the making: written beside its final name, renamed at the end (FORMATS.md, "Job
// folder").
//
// Purpose: nobody ever sees half a job. While this object lives the files are in a hidden sibling;
// publish() makes them the job; without it the destructor removes them.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

class JobDraft {
 public:
  // Refuses a place that is taken (unless `replace`: then the old folder goes at publish()) or
  // cannot be written.
  static Result<JobDraft> begin(const std::filesystem::path& job, bool replace);
  JobDraft(JobDraft&& other) noexcept;
  JobDraft& operator=(JobDraft&&) = delete;
  ~JobDraft();

  const std::filesystem::path& folder() const { return draft_; }
  Status write(const std::string& name, std::string_view bytes) const;
  Status write(const std::string& name, const TriangleMesh& mesh) const;  // binary STL
  Status publish();

 private:
  JobDraft(std::filesystem::path job, std::filesystem::path draft, bool replace);

  std::filesystem::path job_, draft_;
  bool replace_;
};

}  // namespace reforge
