// Records a run of a tree of BehaviorTree.CPP 4.10, so that btcore runs it again in Python: `btcore replay FILE --verify`.
//
//     auto tree = factory.createTree("Main");
//     btcore::Recorder recorder(tree, xml, "run.btrec.txt");  // records until it is destroyed
//     tree.tickWhileRunning();                                // or tickOnce(), haltTree(), …
//
// Recorded are the results, output ports and other writes of the leaves, what the users' own decorators and controls
// do with their children, the results of Sleep, Delay and Timeout, and what is written between the ticks. btcore
// computes everything else again, and compares a checksum of all changes of status.
//
// Not recorded, so that a replay may differ:
// - entries that other threads write within a tick while no leaf is ticked; that a leaf writes, when it is halted, to
//   keys that are not its output ports; that change without a new sequence number (through getAnyLocked() or
//   ImportBlackboardFromJSON()); and the remapping of a blackboard that was passed to createTree();
// - what callbacks and breakpoints (Groot 2) force. They also replace the callbacks of the recorder: use neither;
// - objects of own classes: they are recorded as text, or as JSON if JsonExporter knows them. Enums are numbers.
// The texts of exceptions are recorded only if the program passes them to note_exception().
//
// Tick and halt the tree in one thread. Each tick is written to the file when it has ended. The recorder throws
// BT::RuntimeError at the beginning if it cannot record the tree: if the tree runs already, if the XML has includes,
// if the root has a pre-condition, or for leaves derived from ThreadedAction and
// CoroActionNode, which do not call callbacks: register these as `btcore::Recorded<MyLeaf>`.
//
// License: as btcore. Needs C++17.
#pragma once

#include <algorithm>
#include <array>
#include <behaviortree_cpp/bt_factory.h>
#include <behaviortree_cpp/json_export.h>
#include <chrono>
#include <cmath>
#include <deque>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

namespace btcore {

/// A leaf of a class whose ticks call no callbacks: factory.registerNodeType<btcore::Recorded<MyLeaf>>("MyLeaf").
template <class Leaf>
class Recorded : public BT::ActionNodeBase {
 public:
  Recorded(const std::string& name, const BT::NodeConfig& config)
      : ActionNodeBase(name, config),
        leaf_(name, config),
        subscriber_(leaf_.subscribeToStatusChange([this](auto&&...) {
          if (std::this_thread::get_id() != thread_) emitWakeUpSignal();
        })) {}
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
  struct Document {
    std::string file, text;
  };

  /// `xml` is the whole text from which the tree was loaded; its trees may be defined in several documents, the one
  /// with the main tree last.
  Recorder(BT::Tree& tree, const std::string& xml, const std::string& path)
      : Recorder(tree, std::vector<Document>{{"", xml}}, path) {}
  Recorder(BT::Tree& tree, const std::vector<Document>& documents, const std::string& path)
      : subtrees_(tree.subtrees), thread_(std::this_thread::get_id()) {
    const std::set<std::string> builtins = BT::BehaviorTreeFactory().builtinNodes();
    find_nodes(tree.rootNode(), 0, builtins);
    for (auto board = tree.rootBlackboard(); board; board = board->parent()) add_board(board);
    const size_t outer_count = boards_.size();
    for (const auto& subtree : subtrees_) add_board(subtree->blackboard);
    for (const auto& [uid, node] : nodes_) check(node);
    for (const auto& document : documents)
      if (document.text.find("<include") != std::string::npos)
        refuse("the XML has an <include>: pass the included files as further documents, and remove the include");
    file_.open(path, std::ios::binary | std::ios::trunc);
    if (!file_) refuse("cannot write the recording " + path);
    write_head(tree, documents, outer_count, builtins);
    for (auto& [uid, node] : nodes_) subscribe(node);
  }
  ~Recorder() {
    const std::lock_guard lock(mutex_);
    end_open_step();
    for (auto& [uid, node] : nodes_) {
      node.subscriber.reset();
      node.tree_node->setPreTickFunction({});
      node.tree_node->setPostTickFunction({});
      node.tree_node->setTickMonitorCallback({});
    }
  }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Record an exception that has left tickOnce(). Call it before haltTree().
  void note_exception(const std::exception& error) {
    const std::lock_guard lock(mutex_);
    exception_ = error.what();
    unwind(0, false);
  }
  /// Why the recording has ended before the recorder was destroyed; "" if it goes on.
  std::string ended() const {
    const std::lock_guard lock(mutex_);
    return ended_;
  }

 private:
  using Status = BT::NodeStatus;
  using EntryPtr = std::shared_ptr<BT::Blackboard::Entry>;
  struct KnownEntry {
    EntryPtr entry;
    uint64_t sequence_id;
  };
  struct Board {
    BT::Blackboard::Ptr board;
    size_t scope;
    std::unordered_map<std::string, KnownEntry> known;
  };
  struct Node {
    BT::TreeNode* tree_node;
    int uid, parent;
    bool is_external, is_decorator;
    std::vector<Board*> boards;  // that it can write
    Status status = Status::IDLE;
    bool is_result_next = false;  // whether the next status is the result of its tick
    BT::TreeNode::StatusChangeSubscriber subscriber;
  };
  /// What external code does now: tick a node, tick a child, halt a node, or halt a child.
  enum class Doing { TICK, TICK_CHILD, HALT, HALT_CHILD };
  struct Frame {
    Doing doing;
    int uid;
    size_t line = 0;  // of HALT_CHILD: the number of its line
  };
  enum class State { OUTSIDE, TICKING, ENDING, HALTING, ENDED };

  static constexpr int ROOT = 1;
  static constexpr int64_t UNKNOWN = -1;  // a checksum

  [[noreturn]] static void refuse(const std::string& reason) { throw BT::RuntimeError("btcore::Recorder: ", reason); }
  static const BT::NodeConfig& config_of(const Node& node) {
    return static_cast<const BT::TreeNode&>(*node.tree_node).config();
  }
  static bool is_end(Status status) { return status == Status::SUCCESS || status == Status::FAILURE; }
  static int64_t now() { return std::chrono::steady_clock::now().time_since_epoch().count(); }

  // --- the tree

  void find_nodes(BT::TreeNode* tree_node, int parent, const std::set<std::string>& builtins) {
    if (tree_node == nullptr) refuse("the tree is empty");
    Node node{};
    node.tree_node = tree_node;
    node.uid = tree_node->UID();
    node.parent = parent;
    node.is_external = is_external(tree_node->registrationName(), builtins);
    node.is_decorator = tree_node->type() == BT::NodeType::DECORATOR || tree_node->type() == BT::NodeType::SUBTREE;
    nodes_[node.uid] = node;
    if (auto* control = dynamic_cast<BT::ControlNode*>(tree_node)) {
      for (auto* child : control->children()) find_nodes(child, node.uid, builtins);
    } else if (auto* decorator = dynamic_cast<BT::DecoratorNode*>(tree_node)) {
      find_nodes(decorator->child(), node.uid, builtins);
    }
  }
  static bool is_external(const std::string& id, const std::set<std::string>& builtins) {
    // The results of the timers of BehaviorTree.CPP depend on when their threads run.
    return builtins.count(id) == 0 || id == "Sleep" || id == "Delay" || id == "Timeout";
  }
  void add_board(const BT::Blackboard::Ptr& board) {
    for (const auto& known : boards_)
      if (known.board == board) return;
    boards_.push_back({board, boards_.size(), {}});
  }
  void check(const Node& node) const {
    const auto& config = config_of(node);
    const std::string name = "'" + node.tree_node->fullPath() + "' ";
    if (node.tree_node->status() != Status::IDLE)
      refuse(name + "is not IDLE: begin to record before the first tick, or after haltTree()");
    if (dynamic_cast<BT::ThreadedAction*>(node.tree_node) || dynamic_cast<BT::CoroActionNode*>(node.tree_node))
      refuse(name + "calls no callbacks: register its class as btcore::Recorded<Class>");
    if (dynamic_cast<BT::TestNode*>(node.tree_node) != nullptr) refuse(name + "is replaced by a substitution rule");
    if (node.uid == ROOT && !config.pre_conditions.empty())
      refuse(name + "is the root, and has a pre-condition: put it on a child of the root");
  }
  void subscribe(Node& node) {
    auto& tree_node = *node.tree_node;
    for (auto board = config_of(node).blackboard; board; board = board->parent())
      for (auto& known : boards_)
        if (known.board == board) node.boards.push_back(&known);
    const int uid = node.uid;
    node.subscriber = tree_node.subscribeToStatusChange(
        [this, uid](BT::TimePoint, const BT::TreeNode&, Status, Status status) { status_changed(uid, status); });
    const bool is_child = node.parent != 0 && nodes_.at(node.parent).is_external;
    if (!node.is_external && !is_child && uid != ROOT) return;
    tree_node.setPreTickFunction([this, uid](BT::TreeNode&) { return tick_began(uid), Status::IDLE; });
    if (node.is_external)
      tree_node.setTickMonitorCallback([this, uid](BT::TreeNode&, Status status, auto) { tick_ended(uid, status); });
    if (!is_child && uid != ROOT) return;
    tree_node.setPostTickFunction(
        [this, uid](BT::TreeNode&, Status status) { return tick_left(uid, status), Status::IDLE; });
  }

  // --- callbacks

  void tick_began(int uid) {
    const std::lock_guard lock(mutex_);
    if (uid == ROOT) begin_tick();
    if (!is_working()) return;
    for (Board* board : nodes_.at(uid).boards) read_board(*board, false, false);
    open_ticks(uid);
    if (nodes_.at(uid).is_external) frames_.push_back({Doing::TICK, uid});
    add_late_halts();
  }
  /// The tick() of an external node has returned `status`.
  void tick_ended(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    if (!is_working()) return;
    unwind(uid, true);
    if (is_ticked(uid)) {
      frames_.pop_back();
    } else {  // tick_began() is not called if the status was SUCCESS or FAILURE
      open_ticks(uid);
    }
    Node& node = nodes_.at(uid);
    for (Board* board : node.boards) read_board(*board, true, false);
    add("result", {quote(uid), quote(status)});
    node.is_result_next = status != node.status && status != Status::SKIPPED;
  }
  /// A child of an external node, or the root, has been ticked. Its status is stored next.
  void tick_left(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    if (!is_working()) return;
    const Node& node = nodes_.at(uid);
    unwind(uid, true);
    if (!frames_.empty() && frames_.back().uid == uid) {
      const Frame frame = frames_.back();
      frames_.pop_back();
      if (frame.doing == Doing::HALT_CHILD) lines_[frame.line] = line("child_ticked", {quote(uid)});  // by its tick
    } else if (status == Status::SKIPPED && last_halt_.uid == uid && last_halt_end_ == lines_.size() &&
               config_of(node).pre_conditions.count(BT::PreCond::WHILE_TRUE) != 0) {
      lines_[last_halt_.line] = line("child_ticked", {quote(uid)});  // in which `_while` has halted it
    } else {  // a pre-condition has decided, or tick_began() was not called
      open_ticks(uid);
      if (uid != ROOT && !frames_.empty()) frames_.pop_back();
    }
    if (uid != ROOT) return;
    result_ = status;
    state_ = State::ENDING;
    for (Board& board : boards_) read_board(board, false, false);
    const bool is_stored = status == Status::SKIPPED || node.status == status;
    if (is_stored && !is_end(status) && !node.is_decorator) end_step(result_, checksum_);
  }
  void status_changed(int uid, Status status) {
    const std::lock_guard lock(mutex_);
    Node& node = nodes_.at(uid);
    const bool is_foreign = std::this_thread::get_id() != thread_;
    if (state_ == State::ENDED) return;
    if (is_foreign && timeout_above(uid) != 0) {  // the timer of a Timeout halts its child
      late_.push_back({uid, status});
      return;
    }
    if (state_ == State::ENDING && !belongs_to_end(node, status)) end_step(result_, checksum_);
    if (state_ == State::OUTSIDE) {
      read_boards();
      add("halt", {});
      state_ = State::HALTING;
      thread_ = std::this_thread::get_id();
    }
    change(node, status);
    if (uid != ROOT) return;
    const bool is_stored = status == Status::RUNNING && !node.is_decorator;
    if (state_ == State::ENDING && (status == Status::IDLE || is_stored)) end_step(result_, checksum_);
  }
  /// Return whether a status changes because the root has been ticked, not because the tree is halted.
  bool belongs_to_end(const Node& node, Status status) const {
    if (node.uid == ROOT) return status == result_ || is_end(result_);
    return node.parent == ROOT && nodes_.at(ROOT).is_decorator && is_end(node.status);
  }
  /// Return whether this thread ticks or halts the tree. A TryCatch also ticks leaves when it is halted.
  bool is_working() const {
    return (state_ == State::TICKING || state_ == State::HALTING) && std::this_thread::get_id() == thread_;
  }
  void change(Node& node, Status status) {
    if (status == Status::IDLE) {
      add_reset(node);
    } else if (is_ticked(node.uid) || (is_end(node.status) && node.is_external && !node.is_result_next)) {
      if (!is_ticked(node.uid)) {  // tick_began() was not called
        open_ticks(node.uid);
        frames_.push_back({Doing::TICK, node.uid});
      }
      add("status_set", {quote(node.uid), quote(status)});
    }
    node.is_result_next = false;
    node.status = status;
    checksum_ = (checksum_ * 69069 + node.uid * 8 + static_cast<int>(status) + 1) & 0xFFFFFFFF;
  }

  // --- ticks and halts

  void begin_tick() {
    end_open_step();
    if (state_ == State::ENDED) return;
    thread_ = std::this_thread::get_id();
    add_late_halts();
    read_boards();
    add("tick", {quote(++ticks_), quote(now())});
    state_ = State::TICKING;
  }
  void end_open_step() {
    if (state_ == State::ENDING) end_step(result_, checksum_);
    if (state_ == State::HALTING) end_step(Status::IDLE, checksum_);
    if (state_ != State::TICKING) return;
    unwind(0, false);  // the tick has raised an exception; btcore halts the tree then
    bool is_halted = true;
    for (const auto& [uid, node] : nodes_) is_halted &= node.status == Status::IDLE;
    end_step(Status::IDLE, is_halted ? checksum_ : UNKNOWN);
    if (!is_halted) end("a tick has raised an exception, and the tree was not halted afterwards");
  }
  bool is_ticked(int uid) const {
    return !frames_.empty() && frames_.back().doing == Doing::TICK && frames_.back().uid == uid;
  }
  bool is_above(int above, int uid) const {
    for (uid = nodes_.at(uid).parent; uid != 0; uid = nodes_.at(uid).parent)
      if (uid == above) return true;
    return false;
  }
  /// End what is not done by a node above `uid` nor, if `with_itself`, by `uid`: an exception has ended it.
  void unwind(int uid, bool with_itself) {
    while (!frames_.empty()) {
      const int doing = frames_.back().uid;
      if (uid != 0 && (is_above(doing, uid) || (with_itself && doing == uid))) return;
      abandon();
    }
  }
  void abandon() {
    const Frame frame = frames_.back();
    frames_.pop_back();
    Node& node = nodes_.at(frame.uid);
    if (frame.doing == Doing::TICK) {
      for (Board* board : node.boards) read_board(*board, true, false);
      const bool has_children = dynamic_cast<BT::LeafNode*>(node.tree_node) == nullptr;
      const std::string text = exception_.empty() ? "an exception, whose text was not recorded" : exception_;
      add("raised", {quote(node.uid), "[" + quote(has_children ? "NodeExecutionError" : "exception") + ", " + quote(text) + "]"});
    } else if (frame.doing == Doing::HALT) {
      add("halt_ended", {quote(node.uid), "null"});
    }
  }
  /// Return the nodes below that of the last frame, down to `uid`.
  std::vector<int> path_to(int uid) const {
    const int top = frames_.empty() ? 0 : frames_.back().uid;
    std::vector<int> path;
    for (; uid != top && uid != 0; uid = nodes_.at(uid).parent) path.insert(path.begin(), uid);
    return path;
  }
  /// Add that the nodes on the path to `uid` are ticked.
  void open_ticks(int uid) {
    unwind(uid, false);
    for (const int below : path_to(uid)) {
      if (is_ticked(nodes_.at(below).parent)) {
        add("child_ticked", {quote(below)});
        frames_.push_back({Doing::TICK_CHILD, below});
      }
      if (below != uid && nodes_.at(below).is_external) frames_.push_back({Doing::TICK, below});
    }
  }
  /// Add what external code does when `node` becomes IDLE: it resets or halts the node, or a node above it.
  void add_reset(Node& node) {
    const int uid = node.uid;
    unwind(uid, true);
    while (!frames_.empty() && frames_.back().uid == uid && frames_.back().doing <= Doing::TICK_CHILD) abandon();
    open_halts(node);
    bool is_halting = !frames_.empty() && frames_.back().uid == uid && frames_.back().doing == Doing::HALT;
    if (!late_.empty() && is_above(uid, late_.front().first)) {  // a timer has halted the child
      if (!is_halting) begin_halt(uid);
      is_halting = true;
      add_late_halts();
    }
    const std::vector<std::string> writes = node.is_external ? read_outputs(node) : std::vector<std::string>();
    if (is_halting || (!writes.empty() && node.status == Status::RUNNING)) {
      if (!is_halting) add("halt_began", {quote(uid)});
      lines_.insert(lines_.end(), writes.begin(), writes.end());
      add("status_set", {quote(uid), quote(Status::IDLE)});
      add("halt_ended", {quote(uid), "null"});
      if (is_halting) frames_.pop_back();
    }
    if (!frames_.empty() && frames_.back().uid == uid && frames_.back().doing == Doing::HALT_CHILD) {
      last_halt_ = frames_.back();
      last_halt_end_ = lines_.size();
      frames_.pop_back();
    }
  }
  /// Add the begin of the halts in which `node` becomes IDLE, of the external nodes above it.
  void open_halts(const Node& node) {
    const bool is_running = node.status == Status::RUNNING;
    if (!is_running && node.parent != 0 && nodes_.at(node.parent).is_decorator) {
      // A decorator resets its child at the end of each tick, and only a user's class does it within its tick.
      if (is_ticked(node.parent)) add("status_set", {quote(node.uid), quote(Status::IDLE)});
      return;
    }
    bool is_external = !frames_.empty() && (frames_.back().doing == Doing::TICK || frames_.back().doing == Doing::HALT);
    std::vector<int> path = path_to(node.uid);
    // Only nodes that are RUNNING are halted by the node above them; haltTree() halts all nodes.
    for (size_t i = path.size(); i-- > 0;) {
      if (path[i] == node.uid || nodes_.at(path[i]).status == Status::RUNNING) continue;
      if (i > 0) is_external = false;
      path.erase(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(i));
      break;
    }
    for (const int uid : path) {
      if (is_external && uid == node.uid && !is_running) {
        add("status_set", {quote(uid), quote(Status::IDLE)});
        return;
      }
      if (is_external) {
        begin_child_halt(uid);
      }
      is_external = uid != node.uid && nodes_.at(uid).is_external;
      if (is_external) begin_halt(uid);
    }
  }
  void begin_halt(int uid) {
    add("halt_began", {quote(uid)});
    frames_.push_back({Doing::HALT, uid});
  }
  void begin_child_halt(int uid) {
    frames_.push_back({Doing::HALT_CHILD, uid, lines_.size()});
    add("child_halted", {quote(uid)});
  }
  int timeout_above(int uid) const {
    for (uid = nodes_.at(uid).parent; uid != 0; uid = nodes_.at(uid).parent)
      if (dynamic_cast<BT::TimeoutNode*>(nodes_.at(uid).tree_node) != nullptr) return uid;
    return 0;
  }
  /// Add the halts by timers, which have happened in other threads.
  void add_late_halts() {
    auto late = std::exchange(late_, {});
    while (!late.empty()) {
      int halted = 0;  // the child of a Timeout, whose halt is the last of those in it
      for (int uid = late.front().first; uid != 0; uid = nodes_.at(uid).parent) {
        const bool is_late = std::any_of(late.begin(), late.end(), [uid](auto& change) { return change.first == uid; });
        if (is_late && nodes_.at(uid).parent == timeout_above(uid)) halted = uid;
      }
      begin_child_halt(halted);
      int uid = 0;
      while (uid != halted && !late.empty()) {
        uid = late.front().first;
        change(nodes_.at(uid), late.front().second);
        late.erase(late.begin());
      }
    }
  }

  // --- entries

  /// Take note of the entries that were written since the last call, and add them if they `must_add`.
  void read_board(Board& board, bool must_add, bool must_compare_keys) {
    for (auto& [key, known] : board.known) add_if_written(board, key, known, must_add);
    std::vector<BT::StringView> keys = board.board->getKeys();
    if (keys.size() == board.known.size() && !must_compare_keys) return;
    std::set<std::string> present;
    for (const auto& view : keys) {
      const std::string key(view);
      present.insert(key);
      const EntryPtr entry = board.board->getEntry(key);
      auto& known = board.known[key];
      if (entry == nullptr || entry == known.entry) continue;
      if (must_add && known.entry != nullptr) add("removed", {quote(board.scope), quote(key)});
      known = {entry, 0};
      add_if_written(board, key, known, must_add);
    }
    for (auto at = board.known.begin(); at != board.known.end();) {
      if (present.count(at->first) != 0) {
        ++at;
        continue;
      }
      if (must_add) add("removed", {quote(board.scope), quote(at->first)});
      at = board.known.erase(at);
    }
  }
  void read_boards() {
    for (Board& board : boards_) read_board(board, true, true);
  }
  void add_if_written(Board& board, const std::string& key, KnownEntry& known, bool must_add) {
    const std::lock_guard lock(known.entry->entry_mutex);
    if (known.entry->sequence_id == known.sequence_id) return;
    known.sequence_id = known.entry->sequence_id;
    if (!must_add || known.entry->value.empty()) return;
    const BT::TypeInfo& info = known.entry->info;
    const std::string declared = info.isStronglyTyped() ? quote(type_name(info)) : "null";
    add("written", {quote(board.scope), quote(key), value_of(known.entry->value), declared});
  }
  /// Return the lines of the entries that an external node has written to its output ports.
  std::vector<std::string> read_outputs(const Node& node) {
    const size_t count = lines_.size();
    for (const auto& [port, text] : config_of(node).output_ports) {
      const auto key = BT::TreeNode::getRemappedKey(port, text);
      if (!key) continue;
      const EntryPtr entry = config_of(node).blackboard->getEntry(std::string(*key));
      for (Board* board : node.boards)
        for (auto& [name, known] : board->known)
          if (known.entry == entry) add_if_written(*board, name, known, true);
    }
    const auto added = lines_.begin() + static_cast<std::ptrdiff_t>(count);
    std::vector<std::string> written(added, lines_.end());
    lines_.erase(added, lines_.end());
    return written;
  }
  /// Return the name of a type in btcore. Enums are integers, because scripts compute with their numbers.
  static std::string type_name(const BT::TypeInfo& info) {
    static const std::map<std::type_index, std::string> names{
        {typeid(BT::AnyTypeAllowed), "BT::AnyTypeAllowed"}, {typeid(BT::Any), "BT::Any"},
        {typeid(std::string), "std::string"}, {typeid(bool), "bool"}, {typeid(char), "signed char"},
        {typeid(int8_t), "signed char"}, {typeid(int16_t), "short"}, {typeid(int), "int"}, {typeid(long), "long"},
        {typeid(long long), "long"}, {typeid(uint8_t), "unsigned char"}, {typeid(uint16_t), "unsigned short"},
        {typeid(unsigned), "unsigned int"}, {typeid(unsigned long), "unsigned long"},
        {typeid(unsigned long long), "unsigned long"}, {typeid(float), "float"}, {typeid(double), "double"},
        {typeid(BT::NodeStatus), "BT::NodeStatus"}, {typeid(BT::NodeType), "BT::NodeType"},
        {typeid(BT::PortDirection), "BT::PortDirection"}, {typeid(std::vector<int>), "std::vector<int>"},
        {typeid(std::vector<double>), "std::vector<double>"}, {typeid(std::vector<bool>), "std::vector<bool>"},
        {typeid(std::vector<std::string>), "std::vector<std::string>"}};
    const auto known = names.find(info.type());
    if (known != names.end()) return known->second;
    return info.converter() ? BT::demangle(info.type()) : "int";  // BehaviorTree.CPP has none for enums
  }
  static std::string value_of(const BT::Any& value) {
    using nlohmann::json;
    json data;
    if (value.empty()) return "null";
    if (value.isString()) {
      data = value.cast<std::string>();
    } else if (value.type() == typeid(bool)) {
      data = value.cast<int64_t>() != 0;
    } else if (value.type() == typeid(BT::NodeStatus)) {
      data = {{"__enum", "Status"}, {"name", BT::toStr(static_cast<Status>(value.cast<int64_t>()))}};
    } else if (value.castedType() == typeid(double)) {
      const double real = value.cast<double>();
      data = real;
      if (!std::isfinite(real)) data = {{"__float", std::isnan(real) ? "nan" : real > 0 ? "inf" : "-inf"}};
    } else if (value.castedType() == typeid(uint64_t)) {
      data = value.cast<uint64_t>();
    } else if (value.isIntegral()) {
      data = value.cast<int64_t>();
    } else if (!put_list<int>(value, data) && !put_list<double>(value, data) && !put_list<bool>(value, data) &&
               !put_list<std::string>(value, data)) {
      std::string text = "a " + BT::demangle(value.type());
      if (json own; BT::JsonExporter::get().toJson(value, own)) text += " " + dump(own);
      data = {{"__text", text.substr(0, 1000)}};
    }
    return dump(data);
  }
  template <class T>
  static bool put_list(const BT::Any& value, nlohmann::json& data) {
    auto& any = const_cast<BT::Any&>(value);  // castPtr() is not const
    if (value.castedType() == typeid(std::vector<T>)) {
      data = *any.castPtr<std::vector<T>>();
      return true;
    }
    using Queue = std::shared_ptr<std::deque<T>>;
    if (value.castedType() != typeid(Queue)) return false;
    const Queue& queue = *any.castPtr<Queue>();
    data = {{"__deque", queue == nullptr ? std::deque<T>() : *queue}};
    return true;
  }

  // --- lines

  static std::string dump(const nlohmann::json& data) {
    return data.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }
  static std::string quote(const nlohmann::json& data) { return dump(data); }
  static std::string quote(Status status) { return dump(BT::toStr(status)); }
  static std::string line(const std::string& word, const std::vector<std::string>& values) {
    std::string text = word + " [";
    for (size_t i = 0; i < values.size(); ++i) text += (i == 0 ? "" : ", ") + values[i];
    return text + "]\n";
  }
  void add(const std::string& word, const std::vector<std::string>& values) { lines_.push_back(line(word, values)); }

  void end_step(Status status, int64_t checksum) {
    unwind(0, false);
    write_lines("end", quote(status) + ", " + std::to_string(checksum));
    exception_.clear();
    last_halt_ = {};
    state_ = State::OUTSIDE;
  }
  /// Write the lines so far, and the last line of a part of the file, which has their CRC-32.
  void write_lines(const std::string& word, const std::string& values) {
    uint32_t crc = 0xFFFFFFFF;
    for (const auto& text : lines_) crc = add_to_crc(crc, text), file_ << text;
    crc = ~add_to_crc(crc, "[" + values + "]");
    file_ << word << " [" << values << (values.empty() ? "" : ", ") << crc << "]\n" << std::flush;
    lines_.clear();
    if (!file_) end("the file cannot be written");
  }
  void end(const std::string& reason) {
    ended_ = reason;
    state_ = State::ENDED;
  }
  static uint32_t add_to_crc(uint32_t crc, const std::string& text) {
    static const auto table = [] {
      std::array<uint32_t, 256> values{};
      for (uint32_t i = 0; i < 256; ++i) {
        values[i] = i;
        for (int bit = 0; bit < 8; ++bit) values[i] = (values[i] >> 1) ^ ((values[i] & 1) * 0xEDB88320);
      }
      return values;
    }();
    for (const unsigned char byte : text) crc = table[(crc ^ byte) & 0xFF] ^ (crc >> 8);
    return crc;
  }

  void write_head(const BT::Tree& tree, const std::vector<Document>& documents, size_t outer_count,
                  const std::set<std::string>& builtins) {
    using namespace std::chrono;
    add("btrec", {"1"});
    add("tree", {quote(subtrees_.front()->tree_ID), "4"});
    add("clock", {quote(now()), quote(duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count())});
    add("versions", {R"({"BehaviorTree.CPP":"4.10"})"});
    std::string all_texts;
    for (const auto& [file, text] : documents) {
      all_texts += text;
      add("document", {quote(file), "false"});
      std::string marked = "|";
      for (const char c : text) marked += c == '\n' ? "\n|" : std::string(1, c);
      lines_.push_back(marked + "\n");
    }
    const auto enums = config_of(nodes_.at(ROOT)).enums;
    for (const auto& [name, number] : enums ? *enums : BT::ScriptingEnumsRegistry()) add("enum", {quote(name), quote(number)});
    for (const auto& [id, manifest] : tree.manifests)
      if (is_external(id, builtins) && all_texts.find(id) != std::string::npos) add_class(manifest);
    for (const auto& [uid, node] : nodes_) add("node", {quote(uid), quote(node.tree_node->fullPath())});
    for (size_t i = 0; i < outer_count; ++i) add("outer", {"false", "{}"});
    std::vector<std::string> scopes;
    int index = 0;
    for (Board& board : boards_) {
      read_board(board, false, true);
      nlohmann::json indices = nlohmann::json::object();
      for (const auto& [key, known] : board.known) {
        indices[key] = index++;
        const std::lock_guard lock(known.entry->entry_mutex);
        const std::string declared = quote(type_name(known.entry->info));
        const BT::Any& value = known.entry->value;
        const std::string held = value.empty() ? declared : quote(type_name({value.type(), known.entry->info.converter()}));
        const bool is_same = held == declared || !known.entry->info.isStronglyTyped();
        add("entry", {value_of(value), declared, "false", is_same ? "null" : held, quote(known.entry->sequence_id)});
      }
      scopes.push_back(dump(indices));
    }
    for (const auto& scope : scopes) add("scope", {scope});
    add("ticks", {"0"});
    write_lines("head", "");
  }
  void add_class(const BT::TreeNodeManifest& manifest) {
    const std::string type = BT::toStr(manifest.type);
    const bool has_children = type == "Control" || type == "Decorator";
    bool must_complete = false;
    for (const auto& [uid, node] : nodes_)
      must_complete |= node.tree_node->registrationName() == manifest.registration_ID &&
                       dynamic_cast<BT::SyncActionNode*>(node.tree_node) != nullptr;
    std::string ports;
    for (const auto& [name, port] : manifest.ports) {
      static const std::map<BT::PortDirection, std::string> directions{
          {BT::PortDirection::INPUT, "IN"}, {BT::PortDirection::OUTPUT, "OUT"}, {BT::PortDirection::INOUT, "INOUT"}};
      const std::string initial = port.defaultValue().empty() ? "null" : quote(port.defaultValueString());
      ports += (ports.empty() ? "[" : ", [") + quote(name) + ", " + quote(directions.at(port.direction())) + ", " +
               quote(type_name(port)) + ", " + initial + "]";
    }
    const std::string kind = type == "Control" ? "control" : type == "Decorator" ? "decorator" : "leaf";
    const std::string upper = type == "Control" ? "CONTROL" : type == "Decorator" ? "DECORATOR" : type == "Condition" ? "CONDITION" : "ACTION";
    add("class", {quote(manifest.registration_ID), quote(kind), quote(upper), must_complete && !has_children ? "true" : "false", "[" + ports + "]"});
  }

  std::vector<BT::Tree::Subtree::Ptr> subtrees_;  // keeps the nodes and blackboards
  std::map<int, Node> nodes_;                     // by UID
  std::deque<Board> boards_;
  std::ofstream file_;
  mutable std::mutex mutex_;
  std::thread::id thread_;  // that ticks the tree
  State state_ = State::OUTSIDE;
  std::vector<std::string> lines_;  // of the step
  std::vector<Frame> frames_;
  Frame last_halt_{};         // of a child,
  size_t last_halt_end_ = 0;  // and the number of lines at its end
  std::vector<std::pair<int, Status>> late_;  // changes of statuses by timers
  Status result_ = Status::IDLE;
  int64_t ticks_ = 0;
  int64_t checksum_ = 0;
  std::string exception_;
  std::string ended_;
};

}  // namespace btcore
