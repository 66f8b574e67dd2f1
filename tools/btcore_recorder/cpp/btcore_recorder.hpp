// Records a run of a tree of BehaviorTree.CPP 4.10, so that btcore can run it again: `btcore replay FILE --verify`.
//
//     btcore::Recorder recorder(tree, xml, "run.btrec.txt");  // records until it is destroyed
//     tree.tickWhileRunning();                                // or tickOnce(), haltTree(), …
//
// It records the results of the leaves and what they write, which children the users' own decorators and controls tick
// and halt, the results of Sleep, Delay and Timeout, and what is written between two ticks. btcore computes the rest,
// and compares a checksum of all changes of status. Each tick is written when it has ended.
//
// Use one recorder for a tree, and tick and halt the tree in one thread. BT::RuntimeError is thrown at the beginning if
// the tree cannot be recorded: it is not IDLE, its root has a pre-condition, a substitution rule has replaced a
// built-in node, the XML has an <include>, or a leaf derives from ThreadedAction or CoroActionNode, which call no
// callbacks: register such a leaf as btcore::Recorded<MyLeaf>.
//
// Not recorded, so that a replay may differ:
// - what other threads write within a tick while no leaf is ticked;
// - what a leaf writes to keys that are not its output ports, while it is halted, or if it sees more than 100 entries;
// - values that change without a new sequence number (getAnyLocked(), ImportBlackboardFromJSON());
// - callbacks and breakpoints, also those of Groot 2, which replace the callbacks of the recorder: use neither;
// - remappings of a blackboard that was passed to createTree(), and what nodes remember of ticks before the recording;
// - objects of own classes, except as text (JSON if JsonExporter knows the class). Enums are recorded as numbers.
#pragma once

#include <algorithm>
#include <array>
#include <behaviortree_cpp/bt_factory.h>
#include <behaviortree_cpp/json_export.h>
#include <chrono>
#include <cmath>
#include <deque>
#include <fstream>
#include <iostream>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

namespace btcore {

/// A leaf of a class that calls no callbacks: factory.registerNodeType<btcore::Recorded<MyLeaf>>("MyLeaf").
template <class Leaf>
class Recorded : public BT::ActionNodeBase {
 public:
  Recorded(const std::string& name, const BT::NodeConfig& config) : ActionNodeBase(name, config), leaf_(name, config) {
    subscriber_ = leaf_.subscribeToStatusChange([this](auto&&...) {
      if (std::this_thread::get_id() != thread_) emitWakeUpSignal();
    });
  }
  static BT::PortsList providedPorts() { return BT::getProvidedPorts<Leaf>(); }

 private:
  struct Inner : Leaf {
    using Leaf::Leaf, Leaf::resetStatus;
  };
  BT::NodeStatus tick() override {
    thread_ = std::this_thread::get_id();
    const BT::NodeStatus status = leaf_.executeTick();
    if (status != BT::NodeStatus::RUNNING) leaf_.resetStatus();
    return status;
  }
  void halt() override {
    leaf_.haltNode();
    resetStatus();
  }

  std::thread::id thread_;
  Inner leaf_;
  BT::TreeNode::StatusChangeSubscriber subscriber_;
};

/// Records the ticks and halts of a tree until it is destroyed.
class Recorder {
 public:
  using Documents = std::vector<std::pair<std::string, std::string>>;  // the name of a file, and its text

  Recorder(BT::Tree& tree, const std::string& xml, const std::string& path)
      : Recorder(tree, Documents{{"", xml}}, path) {}
  /// For a tree that is defined in several files; that with the main tree is the last.
  Recorder(BT::Tree& tree, const Documents& documents, const std::string& path)
      : subtrees_(tree.subtrees), nodes_(1), thread_(std::this_thread::get_id()) {
    add_node(tree.rootNode(), 0);
    for (auto board = tree.rootBlackboard(); board; board = board->parent()) add_board(board);
    const size_t outer_count = boards_.size();
    for (const auto& subtree : subtrees_) add_board(subtree->blackboard);
    for (const auto& [file, text] : documents)
      if (text.find("<include") != std::string::npos)
        refuse((file.empty() ? "the XML" : file) + " has an <include>: remove it, and pass the file as a document");
    file_.open(path, std::ios::binary | std::ios::trunc);
    if (!file_) refuse("cannot write " + path);
    write_head(tree, documents, outer_count);
    for (size_t uid = ROOT; uid < nodes_.size(); ++uid) subscribe(static_cast<int>(uid));
  }
  ~Recorder() {
    const std::lock_guard lock(mutex_);
    end_open_step();
    for (size_t uid = ROOT; uid < nodes_.size(); ++uid) {
      nodes_[uid].subscriber.reset();
      nodes_[uid].node->setPreTickFunction({});
      nodes_[uid].node->setTickMonitorCallback({});
      nodes_[uid].node->setPostTickFunction({});
    }
  }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Record an exception that has left tickOnce(). Call it before haltTree().
  void note_exception(const std::exception& error) {
    const std::lock_guard lock(mutex_);
    exception_ = error.what();
    unwind(0, false);
    read_boards(false);
  }

 private:
  using Status = BT::NodeStatus;
  using json = nlohmann::json;
  struct KnownEntry {
    std::shared_ptr<BT::Blackboard::Entry> entry;
    uint64_t sequence_id;
  };
  struct Board {
    BT::Blackboard::Ptr board;
    size_t scope;
    std::unordered_map<std::string, KnownEntry> known;
  };
  struct Node {
    BT::TreeNode* node = nullptr;
    int parent = 0;
    bool is_external = false, is_decorator = false;
    bool is_result_next = false;  // whether its next status is the result of its tick
    Status status = Status::IDLE;
    std::vector<Board*> boards;  // that its own code can write
    std::vector<std::pair<Board*, std::string>> outputs;  // the entries of its output ports
    BT::TreeNode::StatusChangeSubscriber subscriber;
  };
  enum class State { OUTSIDE, TICKING, ENDING, HALTING, ENDED };
  /// What external code does now: it ticks a node, a child, or halts a node, a child.
  enum class Doing { TICK, TICK_CHILD, HALT, HALT_CHILD };
  struct Frame {
    Doing doing;
    int uid;
    size_t line = 0;  // of HALT_CHILD: the number of its line
  };
  static constexpr int ROOT = 1;
  static constexpr size_t MAX_ENTRIES = 100;

  [[noreturn]] static void refuse(const std::string& reason) { throw BT::RuntimeError("btcore::Recorder: ", reason); }
  static bool is_end(Status status) { return status == Status::SUCCESS || status == Status::FAILURE; }
  static int64_t now() { return std::chrono::steady_clock::now().time_since_epoch().count(); }
  const BT::NodeConfig& config(int uid) const { return const_cast<const BT::TreeNode*>(nodes_[uid].node)->config(); }
  bool is_external(const std::string& id) const {
    // Of BehaviorTree.CPP's timers the results are recorded, because they depend on when their threads run.
    return builtins_.count(id) == 0 || id == "Sleep" || id == "Delay" || id == "Timeout";
  }

  void add_node(BT::TreeNode* node, int parent) {
    if (node == nullptr) refuse("the tree is empty, or a decorator has no child");
    const int uid = node->UID();
    nodes_.resize(std::max(nodes_.size(), static_cast<size_t>(uid) + 1));
    nodes_[uid].node = node;
    nodes_[uid].parent = parent;
    nodes_[uid].is_external = is_external(node->registrationName());
    const std::string name = "'" + node->fullPath() + "' ";
    if (node->status() != Status::IDLE) refuse(name + "is not IDLE: begin before the first tick, or after haltTree()");
    if (dynamic_cast<BT::ThreadedAction*>(node) || dynamic_cast<BT::CoroActionNode*>(node))
      refuse(name + "calls no callbacks: register its class as btcore::Recorded<Class>");
    if (dynamic_cast<BT::TestNode*>(node) && !nodes_[uid].is_external)
      refuse(name + "is built in, and replaced by a substitution rule");
    if (uid == ROOT && !config(uid).pre_conditions.empty())
      refuse(name + "is the root, and has a pre-condition: put it on a child of the root");
    if (auto* control = dynamic_cast<BT::ControlNode*>(node))
      for (auto* child : control->children()) add_node(child, uid);
    if (auto* decorator = dynamic_cast<BT::DecoratorNode*>(node)) {
      nodes_[uid].is_decorator = true;
      add_node(decorator->child(), uid);
    }
  }
  void add_board(const BT::Blackboard::Ptr& board) {
    for (const auto& known : boards_)
      if (known.board == board) return;
    boards_.push_back({board, boards_.size(), {}});
  }
  void subscribe(int uid) {
    Node& node = nodes_[uid];
    const bool is_own = builtins_.count(node.node->registrationName()) == 0;
    for (auto board = is_own ? config(uid).blackboard : nullptr; board; board = board->parent())
      for (auto& known : boards_)
        if (known.board == board) node.boards.push_back(&known);
    for (const auto& [port, value] : config(uid).output_ports) {
      const auto key = BT::TreeNode::getRemappedKey(port, value);
      const auto entry = key ? config(uid).blackboard->getEntry(std::string(*key)) : nullptr;
      for (Board* board : node.boards)
        for (const auto& [name, known] : board->known)
          if (known.entry == entry) node.outputs.emplace_back(board, name);
    }
    node.subscriber = node.node->subscribeToStatusChange(
        [this, uid](BT::TimePoint, const BT::TreeNode&, Status, Status status) { status_changed(uid, status); });
    const bool is_watched = uid == ROOT || nodes_[node.parent].is_external;
    if (is_watched || node.is_external)
      node.node->setPreTickFunction([this, uid](BT::TreeNode&) { return tick_began(uid), Status::IDLE; });
    if (node.is_external)
      node.node->setTickMonitorCallback([this, uid](BT::TreeNode&, Status status, auto) { tick_ended(uid, status); });
    if (is_watched)
      node.node->setPostTickFunction(
          [this, uid](BT::TreeNode&, Status status) { return tick_left(uid, status), Status::IDLE; });
  }

  // --- callbacks

  /// The pre-conditions of a node have decided that it is ticked. Not called if its status is SUCCESS or FAILURE.
  void tick_began(int uid) {
    const std::lock_guard lock(mutex_);
    if (uid == ROOT) {
      begin_tick();
    } else if (state_ == State::ENDING || state_ == State::OUTSIDE) {  // a TryCatch ticks a child when it is halted
      end_open_step();
      begin_halt(true);
    }
    if (!is_working()) return;
    unwind(uid, false);
    if (is_doing(Doing::TICK, nodes_[uid].parent)) read_boards(nodes_[uid].parent, true);
    read_boards(uid, false);
    open_ticks(uid);
    if (nodes_[uid].is_external) frames_.push_back({Doing::TICK, uid});
    add_late_halts();
  }
  /// The tick() of an external node has returned `status`. Its post-conditions follow.
  void tick_ended(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    if (!is_working()) return;
    unwind(uid, true);
    if (is_doing(Doing::TICK, uid)) {
      add_late_halts();
      frames_.pop_back();
    } else {
      open_ticks(uid);
    }
    read_boards(uid, true);
    add("result", text(uid), text(status));
    nodes_[uid].is_result_next = status != nodes_[uid].status && status != Status::SKIPPED;
  }
  /// The root, or a child of an external node, has been ticked. Its status is stored next.
  void tick_left(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    if (!is_working()) return;
    unwind(uid, true);
    const std::string ticked = line("child_ticked", text(uid));
    if (!frames_.empty() && frames_.back().uid == uid) {
      if (is_doing(Doing::HALT_CHILD, uid)) lines_[frames_.back().line] = ticked;  // it has reset its children
      frames_.pop_back();
    } else if (status == Status::SKIPPED && last_halt_.uid == uid && last_halt_end_ == lines_.size() &&
               config(uid).pre_conditions.count(BT::PreCond::WHILE_TRUE) != 0) {
      lines_[last_halt_.line] = ticked;  // `_while` has halted it
    } else {
      open_ticks(uid);
      if (is_doing(Doing::TICK_CHILD, uid)) frames_.pop_back();
    }
    if (is_doing(Doing::TICK, nodes_[uid].parent)) read_boards(nodes_[uid].parent, false);
    if (uid != ROOT) return;
    result_ = status;
    state_ = State::ENDING;
    read_boards(false);
    const bool is_stored = status == Status::SKIPPED || nodes_[uid].status == status;
    if (is_stored && !is_end(status) && !nodes_[uid].is_decorator) end_step(result_, checksum_);
  }
  void status_changed(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    if (state_ == State::ENDED) return;
    if (std::this_thread::get_id() != thread_ && timeout_above(uid) != 0) {  // its timer halts its child
      late_.push_back({uid, status});
      return;
    }
    if (state_ == State::ENDING && !belongs_to_tick(uid, status)) end_step(result_, checksum_);
    if (state_ == State::OUTSIDE) begin_halt(status == Status::IDLE);  // else a script may have run already
    change(uid, status);
    const bool is_last = status == Status::IDLE || (status == Status::RUNNING && !nodes_[uid].is_decorator);
    if (state_ == State::ENDING && uid == ROOT && is_last) end_step(result_, checksum_);
  }
  /// Return whether a status changes at the end of a tick of the root, not because the tree is halted.
  bool belongs_to_tick(int uid, Status status) const {
    if (uid == ROOT) return status == result_ || is_end(result_);
    return nodes_[uid].parent == ROOT && nodes_[ROOT].is_decorator && is_end(nodes_[uid].status);
  }
  /// Return whether this thread ticks or halts the tree.
  bool is_working() const {
    return (state_ == State::TICKING || state_ == State::HALTING) && std::this_thread::get_id() == thread_;
  }
  void change(int uid, Status status) {
    Node& node = nodes_[uid];
    const bool is_ticked = is_doing(Doing::TICK, uid);
    if (status == Status::IDLE) {
      add_reset(uid);
    } else if (is_ticked || (node.is_external && is_end(node.status) && !node.is_result_next)) {
      if (!is_ticked) {
        open_ticks(uid);
        frames_.push_back({Doing::TICK, uid});
      }
      add("status_set", text(uid), text(status));
    }
    node.is_result_next = false;
    node.status = status;
    checksum_ = (checksum_ * 69069 + uid * 8 + static_cast<int>(status) + 1) & 0xFFFFFFFF;
  }

  // --- steps: ticks of the root and halts of the tree, and what external code does in them

  void begin_tick() {
    end_open_step();
    if (state_ == State::ENDED) return;
    thread_ = std::this_thread::get_id();
    add_late_halts();
    read_boards(true);
    add("tick", text(++ticks_), text(now()));
    state_ = State::TICKING;
  }
  void begin_halt(bool has_run_nothing) {
    read_boards(has_run_nothing);
    lines_.push_back("halt []\n");
    state_ = State::HALTING;
    thread_ = std::this_thread::get_id();
  }
  void end_open_step() {
    if (state_ == State::ENDING) return end_step(result_, checksum_);
    if (state_ == State::HALTING) return end_step(Status::IDLE, checksum_);
    if (state_ != State::TICKING) return;
    // The tick has raised an exception. btcore halts the tree then: the checksum is only known if this was done.
    const auto is_active = [](const Node& node) { return node.status != Status::IDLE; };
    const bool is_idle = std::none_of(nodes_.begin(), nodes_.end(), is_active);
    end_step(Status::IDLE, is_idle ? checksum_ : -1);
    if (!is_idle) end("a tick has raised an exception, and the tree was not halted");
  }
  bool is_doing(Doing doing, int uid) const {
    return !frames_.empty() && frames_.back().doing == doing && frames_.back().uid == uid;
  }
  bool is_above(int above, int uid) const {
    do uid = nodes_[uid].parent;
    while (uid != 0 && uid != above);
    return uid != 0;
  }
  /// Leave the frames that belong neither to a node above `uid` nor, if `with_itself`, to `uid`.
  void unwind(int uid, bool with_itself) {
    while (!frames_.empty()) {
      const Frame frame = frames_.back();
      if (uid != 0 && (is_above(frame.uid, uid) || (with_itself && frame.uid == uid))) return;
      leave(frame);
    }
  }
  void leave(const Frame frame) {
    frames_.pop_back();
    if (frame.doing == Doing::HALT) add("halt_ended", text(frame.uid), "null");
    if (frame.doing != Doing::TICK) return;
    read_boards(frame.uid, true);
    const bool is_leaf = dynamic_cast<BT::LeafNode*>(nodes_[frame.uid].node) != nullptr;
    const std::string reason = exception_.empty() ? "an exception, whose text was not recorded" : exception_;
    add("raised", text(frame.uid), text({is_leaf ? "exception" : "NodeExecutionError", reason}));
  }
  /// Return the nodes below that of the last frame, down to `uid`.
  std::vector<int> path_to(int uid) const {
    std::vector<int> path;
    const int top = frames_.empty() ? 0 : frames_.back().uid;
    for (; uid != top && uid != 0; uid = nodes_[uid].parent) path.insert(path.begin(), uid);
    return path;
  }
  /// Add that the nodes above `uid` tick it.
  void open_ticks(int uid) {
    unwind(uid, false);
    for (const int below : path_to(uid)) {
      if (is_doing(Doing::TICK, nodes_[below].parent)) {
        add("child_ticked", text(below));
        frames_.push_back({Doing::TICK_CHILD, below});
      }
      if (below != uid && nodes_[below].is_external) frames_.push_back({Doing::TICK, below});
    }
  }
  /// Add what external code does when the node `uid` becomes IDLE: it resets or halts the node, or a node above it.
  void add_reset(int uid) {
    unwind(uid, true);
    while (is_doing(Doing::TICK, uid) || is_doing(Doing::TICK_CHILD, uid)) leave(frames_.back());
    open_halts(uid);
    if (!late_.empty() && is_above(uid, late_.front().first)) {
      if (!is_doing(Doing::HALT, uid)) begin(Doing::HALT, uid);
      add_late_halts();
    }
    const bool is_halted = is_doing(Doing::HALT, uid);
    const size_t begin = lines_.size();
    if (nodes_[uid].is_external && (is_halted || nodes_[uid].status == Status::RUNNING)) read_outputs(uid, true);
    if (!is_halted && lines_.size() > begin)
      lines_.insert(lines_.begin() + static_cast<std::ptrdiff_t>(begin), line("halt_began", text(uid)));
    if (is_halted || lines_.size() > begin) {
      add("status_set", text(uid), text(Status::IDLE));
      add("halt_ended", text(uid), "null");
    }
    if (is_halted) frames_.pop_back();
    if (is_doing(Doing::HALT_CHILD, uid)) {
      last_halt_ = frames_.back();
      last_halt_end_ = lines_.size();
      frames_.pop_back();
    }
  }
  void open_halts(int uid) {
    const bool is_running = nodes_[uid].status == Status::RUNNING;
    const std::string reset = line("status_set", text(uid), text(Status::IDLE));
    if (!is_running && nodes_[nodes_[uid].parent].is_decorator) {
      // Each tick of a decorator ends with the reset of its child. Only within its tick, its own code has done it.
      if (is_doing(Doing::TICK, nodes_[uid].parent)) lines_.push_back(reset);
      return;
    }
    const Doing doing = frames_.empty() ? Doing::TICK_CHILD : frames_.back().doing;
    bool is_by_external = doing == Doing::TICK || doing == Doing::HALT;
    std::vector<int> path = path_to(uid);
    // Only a RUNNING node is halted by the node above it. haltTree() then halts every node.
    const auto is_first = [this, uid](int above) { return above != uid && nodes_[above].status != Status::RUNNING; };
    const auto first = std::find_if(path.rbegin(), path.rend(), is_first);
    if (first != path.rend()) {
      is_by_external &= first + 1 == path.rend();
      path.erase(path.begin(), first.base() - 1);
    }
    for (const int below : path) {
      if (is_by_external && below == uid && !is_running) {
        lines_.push_back(reset);
        return;
      }
      if (is_by_external) begin(Doing::HALT_CHILD, below);
      is_by_external = below != uid && nodes_[below].is_external;
      if (is_by_external) begin(Doing::HALT, below);
    }
  }
  void begin(Doing halt, int uid) {
    frames_.push_back({halt, uid, lines_.size()});
    add(halt == Doing::HALT ? "halt_began" : "child_halted", text(uid));
  }
  int timeout_above(int uid) const {
    do uid = nodes_[uid].parent;
    while (uid != 0 && dynamic_cast<BT::TimeoutNode*>(nodes_[uid].node) == nullptr);
    return uid;
  }
  /// Add the halts by timers, which have happened in other threads.
  void add_late_halts() {
    while (!late_.empty()) {
      int halted = 0;  // the child of a Timeout, whose status changes last
      for (int uid = late_.front().first; uid != 0; uid = nodes_[uid].parent)
        if (nodes_[uid].parent == timeout_above(uid) &&
            std::any_of(late_.begin(), late_.end(), [uid](auto& change) { return change.first == uid; }))
          halted = uid;
      if (halted == 0) return;  // the halt goes on
      begin(Doing::HALT_CHILD, halted);
      if (nodes_[halted].is_external && late_.front().first != halted) begin(Doing::HALT, halted);
      for (int uid = 0; uid != halted;) {
        uid = late_.front().first;
        const Status status = late_.front().second;
        late_.erase(late_.begin());
        change(uid, status);
      }
    }
  }

  // --- entries

  /// Notice the entries that were written since the last call, and add them if they `must_be_added`.
  void read_board(Board& board, bool must_be_added) {
    bool is_same = true;
    for (auto& [key, known] : board.known) {
      is_same &= known.entry.use_count() > 1;  // else it was removed
      read_entry(board, key, known, must_be_added);
    }
    const std::vector<BT::StringView> keys = board.board->getKeys();
    if (is_same && keys.size() == board.known.size()) return;
    const std::set<std::string> present(keys.begin(), keys.end());
    for (auto at = board.known.begin(); at != board.known.end();) {
      is_same = present.count(at->first) != 0 && board.board->getEntry(at->first) == at->second.entry;
      if (!is_same && must_be_added) add("removed", text(board.scope), text(at->first));
      at = is_same ? std::next(at) : board.known.erase(at);
    }
    for (const auto& key : present) read_key(board, key, must_be_added);
  }
  void read_key(Board& board, const std::string& key, bool must_be_added) {
    const auto entry = board.board->getEntry(key);
    if (entry == nullptr) return;
    KnownEntry& known = board.known[key];
    if (known.entry != entry) known = {entry, 0};
    read_entry(board, key, known, must_be_added);
  }
  void read_entry(Board& board, const std::string& key, KnownEntry& known, bool must_be_added) {
    const std::lock_guard lock(known.entry->entry_mutex);
    const BT::TypeInfo& info = known.entry->info;
    const uint64_t previous = std::exchange(known.sequence_id, known.entry->sequence_id);
    if (previous == known.sequence_id || !must_be_added || known.entry->value.empty()) return;
    const std::string declared = info.isStronglyTyped() ? text(type_name(info)) : "null";
    add("written", text(board.scope), text(key), text(encode(known.entry->value)), declared);
  }
  void read_boards(bool must_be_added) {
    for (Board& board : boards_) read_board(board, must_be_added);
  }
  /// Read what the node `uid` can write: all entries, or only its output ports if there are many.
  void read_boards(int uid, bool must_be_added) {
    size_t count = 0;
    for (const Board* board : nodes_[uid].boards) count += board->known.size();
    if (count > MAX_ENTRIES) return read_outputs(uid, must_be_added);
    for (Board* board : nodes_[uid].boards) read_board(*board, must_be_added);
  }
  void read_outputs(int uid, bool must_be_added) {
    for (const auto& [board, key] : nodes_[uid].outputs) read_key(*board, key, must_be_added);
  }
  /// Return the name of a type in btcore.
  static std::string type_name(const BT::TypeInfo& info) {
    std::string name = BT::demangle(info.type());
    if (!info.converter() && name.compare(0, 4, "BT::") != 0) return "int";  // an enum: scripts use its numbers
    if (info.type() == typeid(std::vector<std::string>)) return "std::vector<std::string>";
    if (name.compare(0, 26, "std::shared_ptr<std::deque") == 0) return "BT::AnyTypeAllowed";  // the queue of a Loop
    if (info.type() == typeid(long long) || info.type() == typeid(unsigned long long)) name.resize(name.size() - 5);
    const size_t allocator = name.find(", std::allocator<");
    return allocator == std::string::npos ? name : name.substr(0, allocator) + ">";
  }
  static json encode(const BT::Any& value) {
    json list;
    if (value.empty()) return nullptr;
    if (value.isString()) return value.cast<std::string>();
    if (value.type() == typeid(bool)) return value.cast<int64_t>() != 0;
    if (value.type() == typeid(Status))
      return {{"__enum", "Status"}, {"name", BT::toStr(static_cast<Status>(value.cast<int64_t>()))}};
    if (value.castedType() == typeid(double)) {
      const double real = value.cast<double>();
      if (std::isfinite(real)) return real;
      return {{"__float", std::isnan(real) ? "nan" : real > 0 ? "inf" : "-inf"}};
    }
    if (value.castedType() == typeid(uint64_t)) return value.cast<uint64_t>();
    if (value.isIntegral()) return value.cast<int64_t>();
    if (put<int>(value, list) || put<double>(value, list) || put<bool>(value, list) || put<std::string>(value, list))
      return list;
    std::string name = "a " + BT::demangle(value.type());
    if (BT::JsonExporter::get().toJson(value, list)) name += " " + text(list);
    return {{"__text", name.substr(0, 1000)}};
  }
  template <class T>
  static bool put(const BT::Any& value, json& list) {
    auto& any = const_cast<BT::Any&>(value);  // castPtr() is not const
    if (value.castedType() == typeid(std::vector<T>)) {
      list = *any.castPtr<std::vector<T>>();
    } else if (value.castedType() == typeid(std::shared_ptr<std::deque<T>>)) {
      const auto queue = *any.castPtr<std::shared_ptr<std::deque<T>>>();
      list = {{"__deque", queue ? json(*queue) : json::array()}};
    }
    return !list.is_null();
  }

  // --- lines

  static std::string text(const json& data) { return data.dump(-1, ' ', false, json::error_handler_t::replace); }
  static std::string text(Status status) { return '"' + BT::toStr(status) + '"'; }
  static std::string text(int number) { return std::to_string(number); }
  static std::string text(int64_t number) { return std::to_string(number); }
  static std::string text(uint64_t number) { return std::to_string(number); }
  template <class... Values>
  static std::string line(const char* word, const std::string& first, const Values&... others) {
    return (std::string(word) + " [" + first + ... + (std::string(", ") + others)) + "]\n";
  }
  template <class... Values>
  void add(const char* word, const Values&... values) {
    lines_.push_back(line(word, values...));
  }
  void end_step(Status status, int64_t checksum) {
    unwind(0, false);
    state_ = State::OUTSIDE;
    write("end", text(status) + ", " + text(checksum));
    exception_.clear();
    last_halt_ = {};
  }
  /// Write the lines so far, and a last line, which has their CRC-32.
  void write(const std::string& word, const std::string& values) {
    uint32_t crc = 0xFFFFFFFF;
    for (const auto& part : lines_) {
      crc = add_to_crc(crc, part);
      file_ << part;
    }
    crc = ~add_to_crc(crc, "[" + values + "]");
    file_ << word << " [" << values << (values.empty() ? "" : ", ") << crc << "]\n" << std::flush;
    lines_.clear();
    if (!file_) end("the file cannot be written");
  }
  void end(const std::string& reason) {
    std::cerr << "btcore::Recorder: the recording ends: " << reason << std::endl;
    state_ = State::ENDED;
  }
  static uint32_t add_to_crc(uint32_t crc, const std::string& data) {
    static const auto table = [] {
      std::array<uint32_t, 256> values{};
      for (uint32_t i = 0; i < 256; ++i) {
        values[i] = i;
        for (int bit = 0; bit < 8; ++bit) values[i] = (values[i] >> 1) ^ ((values[i] & 1) * 0xEDB88320);
      }
      return values;
    }();
    for (const unsigned char byte : data) crc = table[(crc ^ byte) & 0xFF] ^ (crc >> 8);
    return crc;
  }
  void write_head(const BT::Tree& tree, const Documents& documents, size_t outer_count) {
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    add("btrec", "1");
    add("tree", text(subtrees_.front()->tree_ID), "4");
    add("clock", text(now()), text(std::chrono::nanoseconds(wall).count()));
    add("versions", text({{"BehaviorTree.CPP", "4.10"}}));
    std::string xml;
    for (const auto& [file, content] : documents) {
      xml += content;
      add("document", text(file), "false");
      std::string marked = "|" + content + "\n";
      for (size_t at = 0; (at = marked.find('\n', at) + 1) < marked.size();) marked.insert(at, "|");
      lines_.push_back(marked);
    }
    if (const auto enums = config(ROOT).enums)
      for (const auto& [name, number] : *enums) add("enum", text(name), text(number));
    for (const auto& [id, manifest] : tree.manifests)
      if (is_external(id) && xml.find(id) != std::string::npos) add_class(manifest);
    for (size_t uid = ROOT; uid < nodes_.size(); ++uid) add("node", text(uid), text(nodes_[uid].node->fullPath()));
    for (size_t i = 0; i < outer_count; ++i) add("outer", "false", "{}");
    std::vector<std::string> scopes;
    int index = 0;
    for (Board& board : boards_) {
      read_board(board, false);
      json indices = json::object();
      for (const auto& [key, known] : board.known) {
        indices[key] = index++;
        const std::lock_guard lock(known.entry->entry_mutex);
        const BT::TypeInfo& info = known.entry->info;
        const BT::Any& value = known.entry->value;
        const bool is_other = !value.empty() && info.isStronglyTyped() && value.type() != info.type();
        const std::string held = is_other ? text(type_name({value.type(), info.converter()})) : "null";
        add("entry", text(encode(value)), text(type_name(info)), "false", held, text(known.sequence_id));
      }
      scopes.push_back(text(indices));
    }
    for (const auto& scope : scopes) add("scope", scope);
    add("ticks", "0");
    write("head", "");
  }
  void add_class(const BT::TreeNodeManifest& manifest) {
    static const char* const directions[] = {"IN", "OUT", "INOUT"};
    std::string type = BT::toStr(manifest.type);
    const std::string kind = type == "Control" ? "control" : type == "Decorator" ? "decorator" : "leaf";
    std::transform(type.begin(), type.end(), type.begin(), [](unsigned char c) { return std::toupper(c); });
    const bool must_complete = std::none_of(nodes_.begin() + ROOT, nodes_.end(), [&manifest](auto& node) {
      return node.node->registrationName() == manifest.registration_ID && !dynamic_cast<BT::SyncActionNode*>(node.node);
    });
    json ports = json::array();
    for (const auto& [name, port] : manifest.ports) {
      const json initial = port.defaultValue().empty() ? json() : json(port.defaultValueString());
      ports.push_back({name, directions[static_cast<int>(port.direction())], type_name(port), initial});
    }
    add("class", text(manifest.registration_ID), text(kind), text(type), must_complete ? "true" : "false", text(ports));
  }

  const std::vector<BT::Tree::Subtree::Ptr> subtrees_;  // keeps the nodes and blackboards
  const std::set<std::string> builtins_ = BT::BehaviorTreeFactory().builtinNodes();
  std::vector<Node> nodes_;  // by UID
  std::deque<Board> boards_;
  std::ofstream file_;
  std::mutex mutex_;
  std::thread::id thread_;  // that ticks the tree
  State state_ = State::OUTSIDE;
  std::vector<std::string> lines_;            // of the step
  std::vector<Frame> frames_;                 // the innermost is the last
  std::vector<std::pair<int, Status>> late_;  // changes of statuses by timers
  Frame last_halt_{};                         // of a child,
  size_t last_halt_end_ = 0;                  // and the number of lines at its end
  Status result_ = Status::IDLE;
  int64_t ticks_ = 0;
  int64_t checksum_ = 0;
  std::string exception_;
};

}  // namespace btcore
