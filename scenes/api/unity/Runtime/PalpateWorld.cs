// A scene of palpate in Unity: stepped with Unity's fixed steps; its fingers and objects are components below it.
using UnityEngine;

[AddComponentMenu("Palpate/World")]
public class PalpateWorld : MonoBehaviour
{
    [Tooltip("Scene file (.toml), or the name of a scene that comes with palpate")]
    public string scene = "hand";

    public Palpate.World World { get; private set; }
    PalpateFinger[] fingers;
    PalpateObject[] objects;
    PalpateHand[] hands;
    double begin;

    void Awake()
    {
        World = Palpate.World.Load(scene);
        fingers = GetComponentsInChildren<PalpateFinger>();
        objects = GetComponentsInChildren<PalpateObject>();
        hands = GetComponentsInChildren<PalpateHand>();
        foreach (PalpateFinger finger in fingers) finger.Begin(this);
        foreach (PalpateHand hand in hands) hand.Begin(this);
        foreach (PalpateObject thing in objects) thing.Begin(World);
        begin = Time.fixedTimeAsDouble;
    }

    void FixedUpdate()
    {
        foreach (PalpateHand hand in hands) hand.Send();
        foreach (PalpateFinger finger in fingers) finger.Send();
        foreach (PalpateObject thing in objects) thing.Send();
        World.StepTo(Time.fixedTimeAsDouble - begin);
        foreach (PalpateFinger finger in fingers) finger.Receive();
        foreach (PalpateObject thing in objects) thing.Receive();
    }

    /// <summary>Where a transform, of the hierarchy below or of any other, is in this world's frame.</summary>
    internal Vector3 Place(Transform of) { return transform.InverseTransformPoint(of.position); }
    internal Quaternion Turn(Transform of) { return Quaternion.Inverse(transform.rotation) * of.rotation; }

    void OnDestroy()
    {
        if (World != null) World.Dispose();
    }
}
